"""Calibrations of a stereo endoscope: our TOML, OpenCV's own, the INI of a dVRK, a pair of ROS camera_info.

All are in the conventions of OpenCV's ``stereoCalibrate``. Only ours says how good the calibration is.
"""

from __future__ import annotations

import configparser
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeAlias

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError, Float64, RecordError, is_finite, needs_package, require_range
from markerseek.files import MIB, read_text, read_toml, settings_from
from markerseek.geometry import Camera, RigidTransform, StereoCameras
from markerseek.vision import opencv

_MAX_BYTES = MIB // 16
"""Largest calibration; one has 2 KB."""

_MAX_SKEW = 1e-3
"""Most that a matrix may differ from a rotation: numbers are often rounded to five digits."""

_MAX_PX = 65_536
"""Most pixels of a sensor along one axis."""

_BASE_MM = (1.0, 100.0)
"""Distances between the cameras that an endoscope can have, in millimetres."""

_MODEL_NAME = re.compile(r"fish|omni|distortion_?(model|type)|\bxi\b", re.IGNORECASE)
"""Names, in files of any kind, of what says by which model a lens distorts."""

_OTHER_MODEL = re.compile(r"fish|equi_?d|kannala|omni|\bmei\b|ucm|double_?sphere|\bfov\b|scaramuzza", re.IGNORECASE)
"""Other models by their names, where a file calls them its camera model, or its type of lens."""

_PINHOLE = frozenset(
    {
        "", "0", "false", "no", "none", "pinhole", "perspective", "plumb_bob", "opencv",
        "brown", "brown_conrady", "radtan", "radial_tangential",
    }
)  # fmt: skip
"""Models whose coefficients are k1, k2, p1, p2, k3, in lower case; and what says that there is no other one."""

_DEEPEST = 50
"""Most brackets in brackets; OpenCV's parser crashes on some ten thousands."""

_COEFFICIENTS = (4, 5, 8, 12, 14)
"""Numbers of coefficients that OpenCV's models of distortion have."""


class StereoSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Keys of the TOML file."""

    left: Camera
    right: Camera
    rotation_vector: tuple[float, float, float]
    """Rotation from the left camera's frame to the right one's as ``cv2.Rodrigues`` gives it, in radians."""
    translation_m: tuple[float, float, float]
    """Translation from the left camera's frame to the right one's, in metres (OpenCV gives it in the unit of the
    calibration target)."""
    calibration_sigma_px: float
    """Standard deviation of the error of the calibration: the reprojection error of points that were not used for
    it."""

    def __post_init__(self) -> None:
        require_range("calibration_sigma_px", self.calibration_sigma_px, low=0, high=100, unit="px", open_low=True)
        if not np.isfinite(self.rotation_vector).all():
            raise ConfigError(f"rotation_vector is {self.rotation_vector}, it must be three finite numbers")
        # The base is checked with the pair.
        self.cameras  # noqa: B018

    @classmethod
    def of(cls, cameras: StereoCameras, *, calibration_sigma_px: float) -> Self:
        """Return the settings of a pair of cameras."""
        x, y, z = Rotation.from_matrix(cameras.left_to_right.rotation).as_rotvec().tolist()
        shift_x, shift_y, shift_z = cameras.left_to_right.translation_m.tolist()
        return cls(
            left=cameras.left,
            right=cameras.right,
            rotation_vector=(x, y, z),
            translation_m=(shift_x, shift_y, shift_z),
            calibration_sigma_px=calibration_sigma_px,
        )

    @property
    def cameras(self) -> StereoCameras:
        """The pair of cameras."""
        turn = Rotation.from_rotvec(self.rotation_vector).as_matrix()
        return _pair(self.left, self.right, turn, np.array(self.translation_m, dtype=float))


def read_stereo(paths: Sequence[Path], *, calibration_sigma_px: float | None = None) -> StereoSettings:
    """Return the calibration of a stereo endoscope.

    ``paths``: a TOML file (``examples/stereo.toml`` shows all keys), an INI file of a dVRK, one or two files of OpenCV
    (``cv2.FileStorage``: YAML, XML or JSON), or the YAML files of ROS of the left and of the right camera.
    ``calibration_sigma_px``: error of the calibration, which only a TOML file states.
    """
    suffixes = {path.suffix.lower() for path in paths}
    if len(paths) in {1, 2} and suffixes <= {".yml", ".yaml", ".xml", ".json"}:
        texts = [_text(path) for path in paths]
        if all(map(_is_of_opencv, paths, texts)):
            numbers = _read_opencv(paths, texts)
            with _naming(*paths):
                return _settings(_of_opencv(numbers), calibration_sigma_px)
        if len(paths) == 2 and suffixes <= {".yml", ".yaml"}:
            left, right = map(_read_camera_info, paths, texts)
            with _naming(*paths):
                return _settings(_of_camera_infos(left, right), calibration_sigma_px)
    if len(paths) != 1 or suffixes <= {".yml", ".yaml"}:
        raise ConfigError(
            f"{_named(paths)}: a calibration is one .toml or .ini file, one or two of OpenCV (.yml, .xml, .json), "
            "or two .yaml files of ROS, the left camera's first; name it so"
        )
    (path,) = paths
    if suffixes == {".ini"}:
        sections = _read_ini(path)
        with _naming(path):
            return _settings(_of_ini(sections), calibration_sigma_px)
    table = read_toml(path, what="stereo calibration")
    if calibration_sigma_px is not None:
        raise ConfigError(f"{path}: it states calibration_sigma_px itself; leave `calibration_sigma_px` out")
    with _naming(path):
        return settings_from(table, StereoSettings)


def _named(paths: Sequence[Path]) -> str:
    return " and ".join(map(str, paths))


@contextmanager
def _naming(*paths: Path) -> Iterator[None]:
    """Put the names of the files before the message of a `ConfigError`."""
    try:
        yield
    except ConfigError as problem:
        raise ConfigError(f"{_named(paths)}: {problem}") from problem


def _text(path: Path) -> str:
    """Return the text of a small file."""
    try:
        return read_text(
            path, most_bytes=_MAX_BYTES, what="the calibration of an endoscope", cure="save it as text in UTF-8"
        )
    except RecordError as problem:
        raise ConfigError(str(problem)) from problem


def _settings(cameras: StereoCameras, calibration_sigma_px: float | None) -> StereoSettings:
    """Return the settings from a file that does not say how good its calibration is."""
    if calibration_sigma_px is None:
        raise ConfigError(
            "the file does not say how good the calibration is; name the reprojection error of points that were not "
            "used for it by `calibration_sigma_px`, 0.2 is usual"
        )
    return StereoSettings.of(cameras, calibration_sigma_px=calibration_sigma_px)


def _pair(
    left: Camera, right: Camera, turn: Float64[np.ndarray, "3 3"], shift_m: Float64[np.ndarray, " 3"]
) -> StereoCameras:
    """Return a pair of cameras; rotation and translation are from the left one's frame to the right one's."""
    to_right = RigidTransform(source="Left", target="Right", rotation=turn, translation_m=shift_m)
    return StereoCameras(left=left, right=right, left_to_right=to_right)


def _camera(of: str, matrix: Sequence[float], coefficients: Sequence[float], size: Sequence[float]) -> Camera:
    """Return a camera from its matrix, row by row, its distortion k1, k2, p1, p2, k3, and the size of its images."""
    fx, skew, cx, second, fy, cy, *third = matrix
    if (second, *third) != (0, 0, 0, 1):
        rows = f"{second:g} {fy:g} {cy:g} and {' '.join(f'{each:g}' for each in third)}"
        raise ConfigError(
            f"{of} camera matrix has the rows {rows} behind the first, 0 fy cy and 0 0 1 are expected: MATLAB writes "
            "it transposed; exchange its rows and columns, and those of R"
        )
    if skew != 0:
        raise ConfigError(f"{of} camera matrix has the skew {skew}; pixels must be square: calibrate with a skew of 0")
    # OpenCV leaves k3 out where it is 0, and others write zeros behind it.
    k1, k2, p1, p2, k3, *more = (*coefficients, 0.0)
    if any(more):
        raise ConfigError(
            f"{of} distortion has {len(coefficients)} coefficients, five are understood (k1, k2, p1, p2, k3), and "
            "those behind them must be 0; calibrate without the rational model"
        )
    width, height = (_whole(f"{of} image {name}", each) for name, each in zip(("width", "height"), size, strict=True))
    return Camera(focal_px=(fx, fy), centre_px=(cx, cy), size_px=(width, height), distortion=(k1, k2, p1, p2, k3))


def _require_pinhole(stated: Iterable[tuple[str, str]]) -> None:
    """Refuse a calibration whose fields, by name and value, state another model than that of OpenCV's pinhole camera.

    Fisheye models have four coefficients too, which mean something else.
    """
    for name, value in stated:
        plain = re.sub(r"[\s-]+", "_", value.strip().strip("\"'").lower())
        other = _OTHER_MODEL.search(plain) and re.search("model|type|lens", name, re.IGNORECASE)
        if other or (_MODEL_NAME.search(name) and plain not in _PINHOLE):
            raise ConfigError(
                f"{name} is {value.strip()[:40]!r}, plumb_bob is understood (of OpenCV's stereoCalibrate: k1, k2, p1, "
                "p2, k3); the coefficients of another model mean something else: calibrate again from the images with "
                "this one, and do not only rename it"
            )


def _rotation(name: str, values: Sequence[float]) -> Float64[np.ndarray, "3 3"]:
    """Return the rotation nearest to nine numbers, row by row; `ConfigError` if they are none."""
    matrix = np.array(values).reshape(3, 3)
    if not (np.abs(matrix.T @ matrix - np.eye(3)).max() < _MAX_SKEW and np.linalg.det(matrix) > 0):
        raise ConfigError(f"{name} is no rotation: {list(values)}; calibrate again, or correct the file")
    first, _, second = np.linalg.svd(matrix)
    return np.asarray(first @ second)


def _in_metres(shift: Sequence[float]) -> Float64[np.ndarray, " 3"]:
    """Return the translation between the cameras, from millimetres or metres; its length shows which."""
    base = float(np.linalg.norm(shift))
    for unit_m in (1e-3, 1.0):
        if _BASE_MM[0] <= 1e3 * unit_m * base <= _BASE_MM[1]:
            return unit_m * np.array(shift)
    raise ConfigError(
        f"the translation (T) has the length {base:g}, which is no distance of an endoscope's cameras in millimetres "
        f"or metres, {_BASE_MM[0]:g} to {_BASE_MM[1]:g} mm: was the size of the target's squares given? Scale T"
    )


_Numbers: TypeAlias = dict[str, Float64[np.ndarray, " numbers"]]
"""What ``cv2.FileStorage`` holds, by its names of `_OPENCV_NAMES`; matrices row by row."""

_OPENCV_NAMES: dict[str, tuple[str, ...]] = {
    "left camera matrix": ("M1", "K1", "cameraMatrix1", "camera_matrix_1", "camera_matrix_left", "cameraMatrixL"),
    "left distortion": ("D1", "distCoeffs1", "dist_coeffs_1", "dist_coeffs_left", "distCoeffsL", "D_left"),
    "right camera matrix": (
        "M2", "K2", "cameraMatrix2", "camera_matrix_2", "camera_matrix_right", "cameraMatrixR",
    ),
    "right distortion": ("D2", "distCoeffs2", "dist_coeffs_2", "dist_coeffs_right", "distCoeffsR", "D_right"),
    "rotation": ("R", "rotation", "R_stereo"),
    "translation": ("T", "translation", "T_stereo"),
    "size of the images": ("imageSize", "image_size", "size", "image_width", "imageWidth", "width"),
    "height of the images": ("image_height", "imageHeight", "height"),
}  # fmt: skip
"""What is read, and its names: of OpenCV's ``stereo_calib``, of its documentation, and of what people write."""


def _is_of_opencv(path: Path, text: str) -> bool:
    """Return whether a text is that of ``cv2.FileStorage``; YAML may be of ROS."""
    return path.suffix.lower() in {".xml", ".json"} or "opencv-matrix" in text or text.startswith("%YAML:1.0")


def _read_opencv(paths: Sequence[Path], texts: Sequence[str]) -> _Numbers:
    """Return the numbers by their names of `_OPENCV_NAMES`, from one file or from several that have a part each.

    Matrices are read row by row.

    Raises `ConfigError` if a file cannot be read.
    """
    cv2 = opencv(f"{paths[0]}: it")
    found: _Numbers = {}
    for path, text in zip(paths, texts, strict=True):
        if _depth(text) > _DEEPEST:
            raise ConfigError(
                f"{path}: it nests brackets more than {_DEEPEST} deep, a calibration needs 5; save it again"
            )
        others: list[str] = []
        stated: list[tuple[str, str]] = []
        try:
            storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            for what, names in _OPENCV_NAMES.items():
                nodes = [node for node in map(storage.getNode, names) if not node.empty()]
                if not nodes:
                    continue
                numbers = np.array(_numbers(nodes[0]), dtype=np.float64)
                if not np.array_equal(numbers, found.setdefault(what, numbers), equal_nan=True):
                    others.append(what)
            stated = [(name, _text_of(storage.getNode(name))) for name in map(str, storage.root().keys())]
        # OpenCV's own error comes wrapped in others.
        except (cv2.error, SystemError, TypeError, ValueError, RecursionError) as problem:
            raise ConfigError(f"{path}: OpenCV cannot read it; save the calibration again") from problem
        with _naming(path):
            _require_pinhole(stated)
        if others:
            raise ConfigError(
                f"{path}: the {others[0]} differs from that of {paths[0]}; name the files of one calibration only"
            )
    return found


def _depth(text: str) -> int:
    """Return the most brackets that are open at once."""
    steps = ((each in "[{") - (each in "]}") for each in text)
    return max(accumulate(steps), default=0)


def _numbers_of(found: _Numbers, what: str, *counts: int) -> list[float]:
    """Return the numbers of one name; `ConfigError` if they are missing, or their count is another."""
    names = ", ".join(_OPENCV_NAMES[what])
    if what not in found:
        raise ConfigError(f"the {what} is missing; it is read as one of: {names}")
    numbers = found[what]
    if numbers.size not in counts or not np.isfinite(numbers).all():
        many = " or ".join(map(str, counts))
        raise ConfigError(f"the {what} ({names}) holds {numbers.size} numbers, {many} finite ones are expected")
    values: list[float] = numbers.tolist()
    return values


def _numbers(node: Any) -> list[float]:
    """Return the numbers of a matrix, or of lists of lists."""
    if node.isSeq():
        return [number for index in range(node.size()) for number in _numbers(node.at(index))]
    if node.isMap():
        return [float(number) for number in np.ravel(node.mat())]
    return [float(node.real())]


def _text_of(node: Any) -> str:
    """Return the text or number of a node; empty of any other."""
    if node.isString():
        return str(node.string())
    return f"{node.real():g}" if node.isInt() or node.isReal() else ""


def _of_opencv(found: _Numbers) -> StereoCameras:
    """Return the pair of OpenCV's files, whose lengths have the unit of the calibration target."""
    if "size of the images" not in found:
        raise ConfigError(
            "the size of the images is missing; add two lines to the file, image_width: 1280 and image_height: 1024, "
            "in its own notation"
        )
    if found["size of the images"].size > 1:
        matrices = [_numbers_of(found, f"{side} camera matrix", 9) for side in ("left", "right")]
        size = _width_and_height(_numbers_of(found, "size of the images", 2), matrices)
    else:
        size = [found["size of the images"].item(), *_numbers_of(found, "height of the images", 1)]
    left, right = (
        _camera(
            f"the {side}",
            _numbers_of(found, f"{side} camera matrix", 9),
            _numbers_of(found, f"{side} distortion", *_COEFFICIENTS),
            size,
        )
        for side in ("left", "right")
    )
    turn = _rotation("rotation (R)", _numbers_of(found, "rotation", 9))
    return _pair(left, right, turn, _in_metres(_numbers_of(found, "translation", 3)))


def _width_and_height(size: list[float], matrices: Sequence[Sequence[float]]) -> list[float]:
    """Return the size of the images in OpenCV's order, also if the file has rows and columns, as NumPy's ``shape``.

    Images that are higher than wide are taken for rows and columns if their principal points are then nearer to the
    middle.
    """
    width, height = size
    if not 0 < width < height:
        return size

    def off_centre(across: float, down: float) -> float:
        return sum(abs(matrix[2] / across - 0.5) + abs(matrix[5] / down - 0.5) for matrix in matrices)

    return [height, width] if off_centre(height, width) < off_centre(width, height) else size


def _read_ini(path: Path) -> configparser.ConfigParser:
    parser = configparser.ConfigParser(interpolation=None, inline_comment_prefixes=("#", ";"))
    try:
        parser.read_string(_text(path))
    except configparser.Error as problem:
        reason = " ".join(str(problem).split())
        raise ConfigError(f"{path}: it cannot be read as an INI file: {reason}") from problem
    return parser


def _of_ini(sections: configparser.ConfigParser) -> StereoCameras:
    """Return the pair of the sections StereoLeft and StereoRight: lengths in mm, distortion k1, k2, p1, p2, k3."""
    for name in ("StereoLeft", "StereoRight"):
        if name not in sections:
            raise ConfigError(f"the section [{name}] is missing; a StereoCalibrationDVRK.ini has it")
    _require_pinhole((f"[{section}] {key}", value) for section in sections for key, value in sections[section].items())

    def numbers(section: str, *keys: str) -> tuple[float, ...]:
        return tuple(_number(f"[{section}] {key}", sections[section].get(key)) for key in keys)

    def camera(section: str) -> Camera:
        fx, fy, cx, cy = numbers(section, "fc_x", "fc_y", "cc_x", "cc_y")
        skew = _number(f"[{section}] alpha_c", sections[section].get("alpha_c", "0"))
        more = [key for key in sections[section] if re.fullmatch(r"kc_([5-9]|\d\d+)", key)]
        coefficients = numbers(section, *(f"kc_{each}" for each in range(5)), *more)
        matrix = (fx, skew, cx, 0, fy, cy, 0, 0, 1)
        return _camera(f"[{section}]", matrix, coefficients, numbers(section, "res_x", "res_y"))

    turns = [f"R_{each}" for each in range(9)]
    shifts = [f"T_{each}" for each in range(3)]
    if turns[0] in sections["StereoLeft"]:
        of_left = (*numbers("StereoLeft", *turns), *numbers("StereoLeft", *shifts))
        if not np.allclose(of_left, (*np.eye(3).ravel(), 0, 0, 0), atol=1e-9):
            raise ConfigError(
                "[StereoLeft] is turned or shifted itself; the frame of the pair is that of the left camera"
            )
    turn = _rotation("[StereoRight] R_0 to R_8", numbers("StereoRight", *turns))
    shift_m = _in_metres(numbers("StereoRight", *shifts))
    return _pair(camera("StereoLeft"), camera("StereoRight"), turn, shift_m)


class _CameraInfo(NamedTuple):
    """One camera of ROS: itself, its rotation into the rectified frame, and its shift there in metres."""

    camera: Camera
    turn: Float64[np.ndarray, "3 3"]
    shift_m: float


_NAMES = {
    "camera_matrix": ("camera_matrix", "K", "k"),
    "distortion_coefficients": ("distortion_coefficients", "D", "d"),
    "rectification_matrix": ("rectification_matrix", "R", "r"),
    "projection_matrix": ("projection_matrix", "P", "p"),
}
"""Names in a calibration file and in a message that was printed, of ROS 1 and ROS 2."""


def _read_camera_info(path: Path, text: str) -> _CameraInfo:
    with needs_package("pyyaml", extra="vision", purpose=f"{path}: it", module="yaml"):
        import yaml
    try:
        # Into texts, lists and tables only: no tag of a file is followed. A message that was printed ends with the line
        # "---" behind it.
        documents = [each for each in yaml.load_all(text, Loader=yaml.BaseLoader) if each]
    except (yaml.YAMLError, RecursionError, ValueError) as problem:
        reason = " ".join(str(problem).split())[:200]
        raise ConfigError(f"{path}: it cannot be read as YAML: {reason}; save the camera_info again") from problem
    if len(documents) != 1 or not isinstance(documents[0], Mapping):
        raise ConfigError(f"{path}: it holds {len(documents)} messages, or none of a camera; save one camera_info")
    with _naming(path):
        return _camera_info(documents[0])


def _camera_info(table: Mapping[str, Any]) -> _CameraInfo:
    _require_pinhole((name, value if isinstance(value, str) else "no text") for name, value in table.items())
    matrix = _values(table, "camera_matrix", 9)
    projection = _values(table, "projection_matrix", 12)
    if not projection[0] > 0:
        raise ConfigError("projection_matrix is not that of a stereo pair; calibrate both cameras together")
    (left, width, across), (top, height, down) = (
        _part(table, axis, whole) for axis, whole in (("x", "width"), ("y", "height"))
    )
    fx, skew, cx, second, fy, cy, *third = matrix
    # The middle of a joined pixel is in the middle of its pixels.
    centre = (cx - left + 0.5) / across - 0.5, (cy - top + 0.5) / down - 0.5
    return _CameraInfo(
        camera=_camera(
            "its",
            (fx / across, skew, centre[0], second, fy / down, centre[1], *third),
            _values(table, "distortion_coefficients", *_COEFFICIENTS),
            (width // across, height // down),
        ),
        turn=_rotation("rectification_matrix", _values(table, "rectification_matrix", 9)),
        shift_m=projection[3] / projection[0],
    )


def _part(table: Mapping[str, Any], axis: str, whole: str) -> tuple[int, int, int]:
    """Return the first pixel and number of pixels of the sensor's region along an axis, and how many are joined to one.

    The matrices of a camera_info are those of the whole sensor; a region without size is the whole.
    """

    def count(name: str, value: object) -> int:
        number = _whole(name, _number(name, value))
        if not 0 <= number <= _MAX_PX:
            raise ConfigError(f"{name} is {number}, it must lie between 0 and {_MAX_PX} pixels")
        return number

    size = count(whole, table.get(f"image_{whole}", table.get(whole)))
    joined = count(f"binning_{axis}", table.get(f"binning_{axis}", "0")) or 1
    roi = table.get("roi", {})
    if not isinstance(roi, Mapping):
        raise ConfigError(f"roi is {_shown(roi)}, it must be a table; save the camera_info again")
    first, length = (count(f"roi: {name}", roi.get(name, "0")) for name in (f"{axis}_offset", whole))
    if first + length > size or (first > 0 and length == 0):
        raise ConfigError(
            f"roi: {whole} is {length} from {first}, the sensor's {whole} is {size}; save the camera_info of the images"
        )
    return first, length or size, joined


def _of_camera_infos(left: _CameraInfo, right: _CameraInfo) -> StereoCameras:
    """Return both cameras turned into one rectified frame, in which the right one is shifted along x."""
    if left.shift_m != 0 or not right.shift_m < 0:
        raise ConfigError(
            f"their projection matrices shift them by {left.shift_m:g} and {right.shift_m:g} m, a left camera has 0, "
            "the right one less; exchange the files, or calibrate the cameras together"
        )
    shift_m = right.turn.T @ np.array([right.shift_m, 0.0, 0.0])
    return _pair(left.camera, right.camera, right.turn.T @ left.turn, shift_m)


def _values(table: Mapping[str, Any], name: str, *counts: int) -> tuple[float, ...]:
    """Return the numbers of a matrix, row by row, by any of its names."""
    found = next((table[each] for each in _NAMES[name] if each in table), None)
    if isinstance(found, Mapping):
        found = found.get("data")
    if not isinstance(found, list) or len(found) not in counts:
        many = " or ".join(map(str, counts))
        raise ConfigError(f"{name} is missing, or not {many} numbers; save the camera_info of a calibrated camera")
    return tuple(_number(name, each) for each in found)


def _number(name: str, value: object) -> float:
    """Return a finite number from text."""
    if value is None:
        raise ConfigError(f"{name} is missing; add it, or save the calibration again")
    try:
        number = float(value) if isinstance(value, str) else None
    except ValueError:
        number = None
    if number is None or not is_finite(number):
        raise ConfigError(f"{name} is {_shown(value)}, it must be a finite number")
    return number


def _shown(value: object) -> str:
    """Return the beginning of a text; no list in full, whose aliases can make it larger than the memory."""
    return repr(value[:40]) if isinstance(value, str) else "no text or number"


def _whole(name: str, value: float) -> int:
    if int(value) != value:
        raise ConfigError(f"{name} is {value}, it must be a whole number of pixels")
    return int(value)
