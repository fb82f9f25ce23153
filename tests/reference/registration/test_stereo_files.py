"""Calibrations of a stereo endoscope in three kinds of file: the same cameras, as OpenCV has them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError
from markerseek.registration import StereoSettings, read_stereo

cv2 = pytest.importorskip("cv2")

LEFT = {"f": (1103.25, 1098.5), "c": (641.125, 508.75), "d": (-0.31, 0.12, 0.0007, -0.0004, 0.013)}
RIGHT = {"f": (1097.75, 1101.0), "c": (629.5, 515.25), "d": (-0.29, 0.09, -0.0005, 0.0006, -1e-05)}
SIZE = (1280, 1024)
TURN = Rotation.from_rotvec([0.004, -0.013, 0.002])
SHIFT_M = np.array([-0.00521, 0.00003, 0.00011])


def matrix(camera: dict[str, Sequence[float]]) -> np.ndarray:
    (fx, fy) = camera["f"]
    (cx, cy) = camera["c"]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def toml(folder: Path) -> list[Path]:
    lines = [
        f"rotation_vector = {TURN.as_rotvec().tolist()}",
        f"translation_m = {SHIFT_M.tolist()}",
        "calibration_sigma_px = 0.2",
    ]
    for name, camera in (("left", LEFT), ("right", RIGHT)):
        lines += [f"[{name}]", f"size_px = {list(SIZE)}", f"focal_px = {list(camera['f'])}"]
        lines += [f"centre_px = {list(camera['c'])}", f"distortion = {list(camera['d'])}"]
    file = folder / "stereo.toml"
    file.write_text("\n".join(lines), encoding="utf-8")
    return [file]


def ini_text() -> str:
    """As dVRK's own files have it: lengths in millimetres."""
    lines = []
    for name, camera in (("StereoLeft", LEFT), ("StereoRight", RIGHT)):
        (fx, fy) = camera["f"]
        (cx, cy) = camera["c"]
        lines += [f"[{name}]", f"res_x={SIZE[0]}", f"res_y={SIZE[1]}", f"fc_x={fx}", f"fc_y={fy}", f"cc_x={cx}"]
        lines += [f"cc_y={cy}", *(f"kc_{number}={value!r}" for number, value in enumerate(camera["d"]))]
    lines += [f"R_{number}={value!r}" for number, value in enumerate(TURN.as_matrix().ravel().tolist())]
    lines += [f"T_{number}={value!r}" for number, value in enumerate((1e3 * SHIFT_M).tolist())]
    return "\n".join(lines)


def ini(folder: Path) -> list[Path]:
    file = folder / "StereoCalibrationDVRK.ini"
    file.write_text(ini_text(), encoding="utf-8")
    return [file]


def camera_info(side: str) -> str:
    """As ROS's camera_calibration writes it: OpenCV's own rectification."""
    cameras = [(matrix(each), np.array(each["d"])) for each in (LEFT, RIGHT)]
    (k1, d1), (k2, d2) = cameras
    r1, r2, p1, p2, *_ = cv2.stereoRectify(k1, d1, k2, d2, SIZE, TURN.as_matrix(), SHIFT_M[:, None])
    k, d, r, p = (k1, d1, r1, p1) if side == "left" else (k2, d2, r2, p2)
    held = {"camera_matrix": k, "distortion_coefficients": d[None], "rectification_matrix": r, "projection_matrix": p}
    lines = [
        f"image_width: {SIZE[0]}",
        f"image_height: {SIZE[1]}",
        f"camera_name: {side}",
        "distortion_model: plumb_bob",
    ]
    for name, values in held.items():
        rows, columns = values.shape
        lines += [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: {values.ravel().tolist()}"]
    return "\n".join(lines) + "\n"


def camera_infos(folder: Path) -> list[Path]:
    files = [folder / "left.yaml", folder / "right.yml"]
    for file in files:
        file.write_text(camera_info(file.stem), encoding="utf-8")
    return files


@pytest.mark.parametrize("written", [toml, ini, camera_infos])
def test_every_kind_of_file_gives_the_same_cameras(tmp_path: Path, written) -> None:
    files = written(tmp_path)
    found = read_stereo(files, calibration_sigma_px=None if written is toml else 0.2)
    assert found.calibration_sigma_px == 0.2
    for camera, expected in ((found.left, LEFT), (found.right, RIGHT)):
        assert (camera.focal_px, camera.centre_px, camera.size_px) == (expected["f"], expected["c"], SIZE)
        assert camera.distortion == expected["d"]
    np.testing.assert_allclose(found.rotation_vector, TURN.as_rotvec(), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.translation_m, SHIFT_M, rtol=0, atol=1e-9)


def refused(files: Sequence[Path], **options: float) -> str:
    with pytest.raises(ConfigError) as problem:
        read_stereo(files, **options)
    return str(problem.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("[StereoRight]", "[Right]"), "[StereoRight] is missing"),
        (("fc_x=1103.25", "fc_x=nan"), "[StereoLeft] fc_x is 'nan'"),
        (("kc_4=0.013", ""), "[StereoLeft] kc_4 is missing"),
        (("res_x=1280", "res_x=1280.5"), "whole number of pixels"),
        (("R_0=", "R_0=1.1 ;"), "no rotation"),
        (("T_0=-5.21", "T_0=-0.00521"), "is no distance of an endoscope"),
        (("[StereoLeft]", "no section"), "cannot be read as an INI file"),
        (("res_y=1024", "res_y=1024\nR_0=0"), "[StereoLeft] R_1 is missing"),
        (("res_y=1024", "res_y=1024\nfisheye=true"), "[StereoLeft] fisheye is 'true', plumb_bob is understood"),
        (("res_y=1024", "res_y=1024\nkc_5=0.3"), "[StereoLeft] distortion has 6 coefficients, five"),
        (("fc_x=1103.25", "fc_x=1103,25"), "fc_x is '1103,25', it must be a finite number"),
    ],
)
def test_an_ini_file_that_lies_is_refused(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    assert change[0] in ini_text()
    file = tmp_path / "stereo.ini"
    file.write_text(ini_text().replace(*change, 1), encoding="utf-8")
    assert says in refused([file], calibration_sigma_px=0.2)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("plumb_bob", "rational_polynomial"), "plumb_bob is understood"),
        (("plumb_bob", "equidistant"), "distortion_model is 'equidistant', plumb_bob is understood"),
        (("camera_name: left", "camera_model: kannala_brandt4"), "camera_model is 'kannala_brandt4', plumb_bob is"),
        (("distortion_model: plumb_bob", "distortion_model: [fisheye]"), "distortion_model is 'no text'"),
        (("camera_name", "binning_x: 2.5\ncamera_name"), "binning_x is 2.5, it must be a whole number"),
        (("camera_name", "roi: 7\ncamera_name"), "roi is '7', it must be a table"),
        (("distortion_coefficients", "coefficients"), "distortion_coefficients is missing"),
        (("data: [1103.25", "data: [[1, 2], 1103.25"), "not 9 numbers"),
        (("data: [1103.25", "data: [.inf"), "must be a finite number"),
        (("image_width: 1280", "image_width: !!python/object/apply:os.getcwd []"), "must be a finite number"),
        (("image_width: 1280", f"image_width: 0x{'f' * 6000}"), "must be a finite number"),
        (("image_width: 1280", "image_width: 21:20"), "width is '21:20', it must be a finite number"),
        (("camera_name", "'a': [" * 3000 + "\ncamera_name"), "cannot be read as YAML"),
    ],
)
def test_a_camera_info_that_lies_is_refused(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    files = camera_infos(tmp_path)
    assert change[0] in camera_info("left")
    files[0].write_text(camera_info("left").replace(*change, 1), encoding="utf-8")
    assert says in refused(files, calibration_sigma_px=0.2)


def test_what_does_not_go_together_is_refused(tmp_path: Path) -> None:
    left, right = camera_infos(tmp_path)
    assert "exchange the files" in refused([right, left], calibration_sigma_px=0.2)
    assert "two .yaml files" in refused([left], calibration_sigma_px=0.2)
    assert "name the reprojection error" in refused([left, right])
    assert "name the reprojection error" in refused(ini(tmp_path))
    assert "calibration_sigma_px is nan" in refused(ini(tmp_path), calibration_sigma_px=float("nan"))
    assert "states calibration_sigma_px itself" in refused(toml(tmp_path), calibration_sigma_px=0.2)
    (tmp_path / "empty.yaml").write_text("", encoding="utf-8")
    assert "holds 0 messages" in refused([tmp_path / "empty.yaml", right], calibration_sigma_px=0.2)
    (tmp_path / "large.ini").write_bytes(b"#" * 70_000)
    assert "another kind of file" in refused([tmp_path / "large.ini"], calibration_sigma_px=0.2)
    assert isinstance(read_stereo([left, right], calibration_sigma_px=0.2), StereoSettings)


def opencv_text(suffix: str, *, size: Sequence[int] = SIZE, **more: object) -> str:
    """As OpenCV's own ``FileStorage`` writes it; ``more``: further fields."""
    storage = cv2.FileStorage(suffix, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for number, camera in enumerate((LEFT, RIGHT), start=1):
        storage.write(f"M{number}", matrix(camera))
        storage.write(f"D{number}", np.array([camera["d"]]))
    storage.write("R", TURN.as_matrix())
    storage.write("T", SHIFT_M[:, None])
    storage.write("image_size", np.array(size, dtype=float))
    for name, value in more.items():
        storage.write(name, value)
    return str(storage.releaseAndGetString())


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"fisheye_model": 1}, "fisheye_model is '1', plumb_bob is understood"),
        ({"distortion_model": "equidistant"}, "distortion_model is 'equidistant'"),
        ({"camera_model": "Omni-Directional"}, "camera_model is 'Omni-Directional'"),
        ({"xi": 1.25}, "xi is '1.25'"),
    ],
)
def test_an_opencv_file_of_another_model_is_refused_by_name(
    tmp_path: Path, suffix: str, more: dict[str, object], says: str
) -> None:
    file = tmp_path / f"stereo{suffix}"
    file.write_text(opencv_text(suffix, **more), encoding="utf-8")
    assert says in refused([file], calibration_sigma_px=0.2)


@pytest.mark.parametrize("more", [{"fisheye_model": 0}, {"camera_model": "pinhole"}, {"model": "Endoscope Xi 30"}])
def test_an_opencv_file_of_this_model_is_read(tmp_path: Path, more: dict[str, object]) -> None:
    file = tmp_path / "stereo.yml"
    file.write_text(opencv_text(".yml", **more), encoding="utf-8")
    assert read_stereo([file], calibration_sigma_px=0.2).left.distortion == LEFT["d"]


@pytest.mark.parametrize("size", [SIZE, SIZE[::-1]])
def test_the_size_of_images_is_read_as_columns_and_rows_or_rows_and_columns(
    tmp_path: Path, size: tuple[int, int]
) -> None:
    file = tmp_path / "stereo.yml"
    file.write_text(opencv_text(".yml", size=size), encoding="utf-8")
    assert read_stereo([file], calibration_sigma_px=0.2).right.size_px == SIZE


def test_images_that_are_higher_than_wide_keep_their_size(tmp_path: Path) -> None:
    text = opencv_text(".yml", size=(1024, 1280)).replace("641.125", "501.5").replace("508.75", "655.25")
    file = tmp_path / "stereo.yml"
    file.write_text(text.replace("629.5", "520.5").replace("515.25", "633.25"), encoding="utf-8")
    assert read_stereo([file], calibration_sigma_px=0.2).left.size_px == (1024, 1280)


@pytest.mark.parametrize(
    ("suffix", "head", "deep"),
    [
        (".json", '{"M1": ', "["),
        (".json", '{"M1": ', '{"a":'),
        (".yml", "%YAML:1.0\nM1: ", "["),
        (".yml", "%YAML:1.0\n", "{a: "),
    ],
)
def test_brackets_in_brackets_do_not_reach_the_parser_of_opencv(
    tmp_path: Path, suffix: str, head: str, deep: str
) -> None:
    file = tmp_path / f"stereo{suffix}"
    file.write_text(head + deep * (50_000 // len(deep)), encoding="utf-8")
    assert "nests brackets more than 50 deep" in refused([file], calibration_sigma_px=0.2)
