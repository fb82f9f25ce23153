"""Field report A11: cameras that read a region of their sensor, or join its pixels, as camera_info says."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError
from markerseek.registration import read_stereo
from markerseek.sim import EndoscopeSettings
from tests.spot_images import spot_images

Shell = Callable[..., tuple[int, str, str]]

SENSOR = (1280, 1024)
MATRIX = np.array([[1090.0, 0, 652.0], [0, 1105.0, 498.0], [0, 0, 1]])
DISTORTION = np.array([-0.3, 0.1, 0.0005, -0.0005, 0.0])
BASE_M = 5.2e-3
TRUS_M = np.array(
    [[-20, -20, 60.8], [20, -20, 58.9], [20, 20, 61.7], [-20, 20, 59.4], [0, 0, 52.1], [8, -15, 67], [-12, 3, 64]]
) * 1e-3  # fmt: skip
# The camera looks at the middle of the points from a distance of 100 mm.
TURN = Rotation.from_euler("xz", [165, 33], degrees=True)
MOVE_M = TRUS_M.mean(axis=0) - TURN.apply([0.002, 0.001, 0.1])


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """``register`` writes registration.json into the current folder."""
    monkeypatch.chdir(tmp_path_factory.mktemp("here"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """What one camera reads of its sensor."""

    first: tuple[int, int] = (0, 0)
    size: tuple[int, int] = (0, 0)
    joined: tuple[int, int] = (0, 0)

    @property
    def image_size(self) -> tuple[int, int]:
        sizes = (self.size[axis] or SENSOR[axis] for axis in range(2))
        width, height = (size // (joined or 1) for size, joined in zip(sizes, self.joined, strict=True))
        return width, height

    def pixels(self, sensor_px: np.ndarray) -> np.ndarray:
        """Pixels of the image: a joined pixel's centre is the mean of those of its pixels."""
        joined = np.maximum(self.joined, 1)
        return (sensor_px - np.array(self.first) + 0.5) / joined - 0.5

    def camera_info(self, shift_m: float, *, printed: bool) -> str:
        """As ROS prints a message, or as a driver saves it."""
        numbers = {"D": DISTORTION, "K": MATRIX.ravel(), "R": np.eye(3).ravel()}
        numbers["P"] = np.column_stack([MATRIX, [MATRIX[0, 0] * shift_m, 0, 0]]).ravel()
        lines = [f"height: {SENSOR[1]}", f"width: {SENSOR[0]}", "distortion_model: plumb_bob"]
        names = {"D": "d", "K": "k", "R": "r", "P": "p"}
        lines += [f"{name if printed else names[name]}: {each.tolist()}" for name, each in numbers.items()]
        lines += [f"binning_x: {self.joined[0]}", f"binning_y: {self.joined[1]}", "roi:"]
        lines += [f"  x_offset: {self.first[0]}", f"  y_offset: {self.first[1]}"]
        lines += [f"  height: {self.size[1]}", f"  width: {self.size[0]}", "  do_rectify: false"]
        return "\n".join(lines) + ("\n---\n" if printed else "\n")


def cameras(folder: Path, left: Part, right: Part, *, printed: bool = True) -> list[object]:
    for name, part, shift_m in (("l", left, 0.0), ("r", right, -BASE_M)):
        (folder / f"{name}.yaml").write_text(part.camera_info(shift_m, printed=printed), encoding="utf-8")
    return ["--cameras", folder / "l.yaml", "--cameras", folder / "r.yaml", "--calibration-sigma-px", 0.2]


def seen(left: Part, right: Part) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of the points in both images, by OpenCV."""
    camera_m = TURN.inv().apply(TRUS_M - MOVE_M)
    return tuple(
        part.pixels(cv2.projectPoints(camera_m, np.zeros(3), np.array([-shift_m, 0, 0]), MATRIX, DISTORTION)[0][:, 0])
        for part, shift_m in ((left, 0.0), (right, BASE_M))
    )


def table(path: Path, left: Part, right: Part, *, seed: int = 1) -> Path:
    rng = np.random.default_rng(seed)
    trus_m = TRUS_M + rng.normal(0, 1e-4, TRUS_M.shape)
    pixels = np.hstack(seen(left, right)) + rng.normal(0, 0.1, (len(TRUS_M), 4))
    head = "trus_x_m,trus_y_m,trus_z_m,left_x_px,left_y_px,right_x_px,right_y_px,spot_sigma_px,"
    head += "trus_sigma_x_m,trus_sigma_y_m,trus_sigma_z_m"
    rows = np.hstack([trus_m, pixels, np.tile([0.1, 1e-4, 1e-4, 1e-4], (len(TRUS_M), 1))])
    path.write_text("\n".join([head, *(",".join(map(repr, row)) for row in rows.tolist())]), encoding="utf-8")
    return path


PARTS = {
    "whole": (Part(), Part()),
    "region": (Part(first=(140, 112), size=(1000, 800)),) * 2,
    "issue": (Part(first=(40, 30), size=(1200, 960)),) * 2,
    "different regions": (Part(first=(150, 40), size=(1100, 900)), Part(first=(60, 110), size=(1150, 880))),
    "joined": (Part(joined=(2, 2)),) * 2,
    "joined along rows": (Part(joined=(4, 1)),) * 2,
    "region of joined": (Part(first=(100, 60), size=(1100, 900), joined=(2, 2)),) * 2,
}


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("printed", [True, False])
def test_a11_the_registration_of_a_part_of_the_sensor_is_that_of_the_whole(
    shell: Shell, tmp_path: Path, name: str, printed: bool
) -> None:
    left, right = PARTS[name]
    points = table(tmp_path / "points.csv", left, right)
    code, out, err = shell("register", points, *cameras(tmp_path, left, right, printed=printed), "--json")
    assert code == 0, err
    report = json.loads(out)
    found = np.array(report["davinci_to_trus"])
    target_m = np.array(report["target_trus_m"])
    true_camera_m = TURN.inv().apply(target_m - MOVE_M)
    error_m = float(np.linalg.norm(found[:3, :3] @ true_camera_m + found[:3, 3] - target_m))
    # The printed error is honest: the true one is within what is expected in 95 %.
    assert error_m < report["tre95_m"] < 2e-3


@pytest.mark.parametrize("name", PARTS)
def test_a11_its_cameras_project_to_the_pixels_of_the_images(tmp_path: Path, name: str) -> None:
    left, right = PARTS[name]
    cameras(tmp_path, left, right)
    stereo = read_stereo([tmp_path / "l.yaml", tmp_path / "r.yaml"], calibration_sigma_px=0.2)
    camera_m = TURN.inv().apply(TRUS_M - MOVE_M)
    for found, expected in zip(stereo.cameras.project(camera_m), seen(left, right), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-6)
    assert (stereo.left.size_px, stereo.right.size_px) == (left.image_size, right.image_size)


def test_a11_pixels_outside_of_the_region_are_refused(shell: Shell, tmp_path: Path) -> None:
    """Pixels that count from the sensor's corner."""
    region = Part(first=(340, 312), size=(600, 400))
    points = table(tmp_path / "points.csv", Part(), Part())
    code, out, _ = shell("register", points, *cameras(tmp_path, region, region), "--json")
    assert code == 2
    assert "outside the image of 600 x 400" in json.loads(out)["error"]


def test_a11_images_have_the_size_of_the_region(shell: Shell, tmp_path: Path) -> None:
    region = Part(first=(290, 212), size=(700, 600))
    calibration = cameras(tmp_path, region, region)
    _, out, _ = shell("search", "--seed", 1, "--no-journal", "--json")
    result, words, rng = json.loads(out), [], np.random.default_rng(4)
    # Three of the points are in the middle of the sensor.
    kept = [number for number, pixel in enumerate(seen(region, region)[0]) if (np.abs(pixel - 325) < 250).all()][:3]
    assert len(kept) == 3
    for number in kept:
        path = tmp_path / f"{number}.json"
        path.write_text(json.dumps(result | {"marker_trus_m": TRUS_M[number].tolist()}), encoding="utf-8")
        words += ["--journal", path]
        for side, pixels in zip("lr", seen(region, region), strict=True):
            folder = tmp_path / side / str(number)
            folder.mkdir(parents=True)
            settings = EndoscopeSettings(frames=3)
            for frame, image in enumerate(spot_images(pixels[number], size_px=region.size, settings=settings, rng=rng)):
                assert cv2.imwrite(str(folder / f"{frame}.png"), image)
    frames = ["--frames", tmp_path / "l", tmp_path / "r", *words, "--json"]
    code, out, err = shell("register", *frames, *calibration)
    assert code == 0, err
    matrix = np.array(json.loads(out)["davinci_to_trus"])
    for point, number in zip(json.loads(out)["points"], kept, strict=True):
        mapped_m = matrix[:3, :3] @ TURN.inv().apply(TRUS_M[number] - MOVE_M) + matrix[:3, 3]
        assert np.linalg.norm(mapped_m - TRUS_M[number]) < 1.5e-3, point
    code, out, _ = shell("register", *frames, *cameras(tmp_path, Part(), Part()))
    assert code == 2
    assert "images of 700 x 600 pixels, the camera's calibration is of 1280 x 1024" in json.loads(out)["error"]


@pytest.mark.parametrize(
    ("part", "says"),
    [
        (Part(first=(400, 0), size=(1000, 800)), "roi: width is 1000 from 400, the sensor's width is 1280"),
        (Part(first=(0, 200), size=(0, 0)), "roi: height is 0 from 200"),
        (Part(first=(-4, 0), size=(1000, 800)), "roi: x_offset is -4"),
        (Part(joined=(-2, 1)), "binning_x is -2"),
        (Part(joined=(100, 1)), "size_px is 12"),
    ],
)
def test_a11_a_part_that_cannot_be_is_refused(tmp_path: Path, part: Part, says: str) -> None:
    cameras(tmp_path, part, Part())
    with pytest.raises(ConfigError) as problem:
        read_stereo([tmp_path / "l.yaml", tmp_path / "r.yaml"], calibration_sigma_px=0.2)
    assert says in str(problem.value)


RIGHT = np.array([[1088.0, 0, 640.0], [0, 1101.0, 505.0], [0, 0, 1]])
PAIR_TURN = Rotation.from_rotvec([0.01, -0.02, 0.005]).as_matrix()
PAIR_SHIFT_M = np.array([-5.2e-3, 1e-4, 2e-4])


def opencv_values(*, unit_m: float = 1e-3) -> dict[str, object]:
    """What ``stereo_calib`` writes, with the size of the images."""
    values: dict[str, object] = {
        "M1": MATRIX, "D1": DISTORTION, "M2": RIGHT, "D2": DISTORTION[None, :4],
    }  # fmt: skip
    return values | {"R": PAIR_TURN, "T": PAIR_SHIFT_M[:, None] / unit_m, "image_width": 1280, "image_height": 1024}


def written(path: Path, values: dict[str, object]) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        storage.write(name, value)
    storage.release()
    return path


@pytest.mark.parametrize("suffix", [".yml", ".yaml", ".xml", ".json"])
@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("unit_m", [1e-3, 1.0])
def test_calibrations_of_opencv_are_read(tmp_path: Path, suffix: str, parts: int, unit_m: float) -> None:
    values = opencv_values(unit_m=unit_m)
    names = list(values)
    pieces = [names] if parts == 1 else [names[:4], names[4:]]
    paths = [
        written(tmp_path / f"{number}{suffix}", {name: values[name] for name in piece})
        for number, piece in enumerate(pieces)
    ]
    found = read_stereo(paths, calibration_sigma_px=0.2)
    assert (found.left.focal_px, found.left.centre_px, found.left.size_px) == ((1090.0, 1105.0), (652.0, 498.0), SENSOR)
    assert found.right.centre_px == (640.0, 505.0)
    assert found.left.distortion == pytest.approx(DISTORTION)
    assert found.right.distortion == pytest.approx([*DISTORTION[:4], 0.0])
    assert found.rotation_vector == pytest.approx([0.01, -0.02, 0.005])
    assert found.translation_m == pytest.approx(PAIR_SHIFT_M)


def test_plain_json_with_other_names_is_read(tmp_path: Path) -> None:
    values = {
        "cameraMatrix1": MATRIX.tolist(), "distCoeffs1": [DISTORTION.tolist()], "cameraMatrix2": RIGHT.tolist(),
        "distCoeffs2": DISTORTION.tolist(), "R": PAIR_TURN.tolist(), "T": [[1e3 * each] for each in PAIR_SHIFT_M],
        "imageSize": [1280, 1024],
    }  # fmt: skip
    (tmp_path / "a.json").write_text(json.dumps(values))
    found = read_stereo([tmp_path / "a.json"], calibration_sigma_px=0.2)
    assert found.translation_m == pytest.approx(PAIR_SHIFT_M)
    assert found.right.size_px == SENSOR


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"image_width": None, "image_height": None}, "size of the images is missing; add two lines"),
        ({"M2": None}, "the right camera matrix is missing; it is read as one of: M2, K2"),
        ({"T": PAIR_SHIFT_M * 40}, "was the size of the target's squares given"),
        ({"D1": np.array([0.1, 0, 0, 0, 0, 0.2, 0, 0])}, "left distortion has 8 coefficients, five are understood"),
        ({"R": np.eye(3) * 2}, "rotation .R. is no rotation"),
        ({"D1": np.zeros(3)}, "holds 3 numbers, 4 or 5 or 8"),
        ({"M1": MATRIX * np.nan}, "9 finite ones are expected"),
        ({"M2": RIGHT.T}, "right camera matrix has the rows 0 1101 0 and 640 505 1 .* MATLAB writes it transposed"),
    ],
)
def test_what_is_no_calibration_of_opencv_says_why(tmp_path: Path, changes: dict[str, object], said: str) -> None:
    values = {name: value for name, value in (opencv_values() | changes).items() if value is not None}
    with pytest.raises(ConfigError, match=f"a.yml: .*{said}"):
        read_stereo([written(tmp_path / "a.yml", values)], calibration_sigma_px=0.2)


def test_text_that_opencv_cannot_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.yml").write_text("%YAML:1.0\n---\nM1: [1, 2")
    with pytest.raises(ConfigError, match=r"a\.yml: OpenCV cannot read it"):
        read_stereo([tmp_path / "a.yml"], calibration_sigma_px=0.2)


def test_two_calibrations_of_opencv_are_not_mixed(tmp_path: Path) -> None:
    first, second = written(tmp_path / "a.yml", opencv_values()), written(tmp_path / "b.yml", opencv_values())
    assert read_stereo([first, second], calibration_sigma_px=0.2).left.size_px == SENSOR
    written(second, opencv_values() | {"D2": DISTORTION * 0.5})
    with pytest.raises(ConfigError, match=r"b\.yml: the right distortion differs from that of .*a\.yml"):
        read_stereo([first, second], calibration_sigma_px=0.2)


@pytest.mark.parametrize(("more", "said"), [((0.0, 0.0, 0.0), None), ((0.0, 0.1, 0.0), "8 coefficients, five are")])
def test_plumb_bob_of_eight_numbers(tmp_path: Path, more: tuple[float, ...], said: str | None) -> None:
    for name, shift_m in (("l", 0.0), ("r", -BASE_M)):
        text = Part().camera_info(shift_m, printed=True)
        (tmp_path / f"{name}.yaml").write_text(
            text.replace(str(DISTORTION.tolist()), str([*DISTORTION.tolist(), *more]))
        )
    paths = [tmp_path / "l.yaml", tmp_path / "r.yaml"]
    if said is None:
        assert read_stereo(paths, calibration_sigma_px=0.2).left.distortion == pytest.approx(DISTORTION)
    else:
        with pytest.raises(ConfigError, match=said):
            read_stereo(paths, calibration_sigma_px=0.2)


@pytest.mark.parametrize("factor", [2, 1.5, 4])
def test_pixels_of_smaller_images_than_the_calibrations_are_said_so(
    shell: Shell, tmp_path: Path, factor: float
) -> None:
    points = table(tmp_path / "points.csv", Part(joined=(factor, factor)), Part(joined=(factor, factor)))
    code, _, err = shell("register", points, *cameras(tmp_path, Part(), Part()))
    assert code == 2
    width, height = round(SENSOR[0] / factor), round(SENSOR[1] / factor)
    assert f"would if its pixels were of images of {width} x {height}, {factor:g} times smaller than the 1280 x" in err
    assert "mirror" not in err


def test_points_that_do_not_fit_at_any_size_are_judged_as_before(shell: Shell, tmp_path: Path) -> None:
    """Two points are exchanged."""
    points = table(tmp_path / "points.csv", Part(), Part())
    lines = points.read_text(encoding="utf-8").split("\n")
    first, second = (line.split(",") for line in lines[1:3])
    lines[1], lines[2] = ",".join(first[:3] + second[3:]), ",".join(second[:3] + first[3:])
    points.write_text("\n".join(lines), encoding="utf-8")
    code, out, err = shell("register", points, *cameras(tmp_path, Part(), Part()), "--json")
    assert code == 3, err
    assert json.loads(out)["reason"]
