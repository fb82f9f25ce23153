"""``markerseek register``: from a CSV, from searches, on the simulated rig, and what it refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from msgspec import structs
from scipy.spatial.transform import Rotation

from markerseek.core import Measured, StereoPair
from markerseek.records.journal import read_journal
from markerseek.registration import SessionRecord, SpotRefused, StereoSettings, camera_text, read_registration
from markerseek.registration.points import read_camera_images
from markerseek.sim import EndoscopeSettings, endoscope
from markerseek.vision import find_spot
from tests import registration_sessions as sessions
from tests.spot_images import spot_images

Shell = Callable[..., tuple[int, str, str]]

TRUS_M = (
    np.array([[-20, -20, 60.8], [20, -20, 58.9], [20, 20, 61.7], [-20, 20, 59.4], [0, 0, 62.1], [10, -5, 57]]) * 1e-3
)
TURN = Rotation.from_euler("xz", [150, 33], degrees=True).as_matrix()
MOVE_M = np.array([0.002, 0.046, 0.147])
CAMERA_M = (TRUS_M - MOVE_M) @ TURN
EXAMPLE = Path(__file__).parents[2] / "examples" / "points.csv"
TRUS = "trus_x_m,trus_y_m,trus_z_m"
CAMERA = "camera_x_m,camera_y_m,camera_z_m"


def rows(head: str, *columns: np.ndarray) -> str:
    """The text of a table."""
    return "\n".join([head, *(",".join(map(repr, row)) for row in np.hstack(columns).tolist())]) + "\n"


def table(path: Path, trus_m: np.ndarray = TRUS_M, camera_m: np.ndarray = CAMERA_M) -> Path:
    path.write_text(rows(f"{TRUS},{CAMERA}", trus_m, camera_m), encoding="utf-8")
    return path


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """``register`` writes registration.json into the current folder."""
    monkeypatch.chdir(tmp_path)


def test_a_registration_is_written_into_a_file(shell: Shell, tmp_path: Path) -> None:
    code, out, _ = shell("register", EXAMPLE, "--json")
    assert code == 0
    assert json.loads((tmp_path / "registration.json").read_text()) == json.loads(out)
    assert read_registration(Path("registration.json")).simulated is False


def test_another_registration_is_replaced_by_force_only(shell: Shell, tmp_path: Path) -> None:
    first = table(tmp_path / "a.csv")
    second = table(tmp_path / "b.csv", camera_m=CAMERA_M + 0.01)
    kept = tmp_path / "registration.json"
    assert [shell("register", first)[0], shell("register", first)[0]] == [0, 0]
    held = kept.read_bytes()
    code, _, err = shell("register", second)
    assert (code, kept.read_bytes()) == (2, held)
    assert "registration.json: another registration is in this folder; --force replaces it" in " ".join(err.split())
    assert shell("register", second, "--force")[0] == 0
    assert kept.read_bytes() != held


def test_the_file_of_a_session_is_not_replaced_by_other_points(shell: Shell) -> None:
    sessions.begin(Path(), markers=3).close()
    held = Path("registration.json").read_bytes()
    code, _, err = shell("register", EXAMPLE, "--force")
    assert (code, Path("registration.json").read_bytes()) == (2, held)
    assert "the current folder holds a registration session" in " ".join(err.split())


def test_exact_points_give_the_exact_transform_as_json(shell: Shell, tmp_path: Path) -> None:
    code, out, err = shell("register", table(tmp_path / "p.csv"), "--json")
    assert (code, err) == (0, "")
    report = json.loads(out)
    expected = np.eye(4)
    expected[:3, :3] = TURN
    expected[:3, 3] = MOVE_M
    np.testing.assert_allclose(report["davinci_to_trus"], expected, atol=1e-9)
    assert (report["registered"], report["weights"]) == (True, "equal")
    assert report["fre_m"] == pytest.approx(0, abs=1e-9)
    assert set(report["frames"]) == {"davinci", "trus"}
    assert [point["name"] for point in report["points"]] == list("123456")
    middle = TRUS_M.mean(axis=0)
    under = np.array(report["target_trus_m"])
    assert np.hypot(*(middle - under)[[0, 2]]) == pytest.approx(20e-3)
    assert "simulation" not in report


def test_sigmas_are_used_and_the_error_is_given_at_the_target_that_was_asked_for(shell: Shell) -> None:
    near, far = (json.loads(shell("register", EXAMPLE, "--json", "--target-mm", 0, 0, depth)[1]) for depth in (60, 20))
    assert near["weights"] == "sigmas of both"
    assert near["target_trus_m"] == [0, 0, 0.06]
    assert near["davinci_to_trus"] == far["davinci_to_trus"]
    assert near["tre_m"] < far["tre_m"]
    # The camera's depth is known to 0.53 mm only, and its focal length may stretch it.
    assert 0.5e-3 < near["expected_fre_m"] < 0.9e-3
    # Base and focal length are in it, which no residual shows.
    assert near["tre_m"] < 1.2 * near["expected_fre_m"]
    assert near["tre_m"] < near["tre95_m"] < 2.5 * near["tre_m"]


def test_points_as_a_spreadsheet_with_decimal_commas_saves_them(shell: Shell, tmp_path: Path) -> None:
    text = EXAMPLE.read_text(encoding="utf-8").replace(",", ";").replace(".", ",")
    (tmp_path / "points.csv").write_bytes(text.encode("utf-8-sig"))
    _, same, _ = shell("register", tmp_path / "points.csv", "--json")
    _, out, _ = shell("register", EXAMPLE, "--json")
    assert json.loads(same)["davinci_to_trus"] == json.loads(out)["davinci_to_trus"]


def test_the_table_names_every_point_and_the_picture_is_drawn(shell: Shell, tmp_path: Path) -> None:
    code, out, _ = shell("register", EXAMPLE, "--plot", "--out", tmp_path)
    assert code == 0
    assert "registered: points.csv, 5 points" in out
    assert "expected TRE" in out
    assert (tmp_path / "register.png").read_bytes().startswith(b"\x89PNG")


def changed(row: int, column: int, value: float) -> np.ndarray:
    points = TRUS_M.copy()
    points[row, column] = value
    return points


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            rows(f"{TRUS},{CAMERA}", changed(1, 2, np.nan), CAMERA_M),
            "line 3: trus_z_m is nan, it must be finite; leave that point out",
        ),
        (rows(f"{TRUS},{CAMERA}", TRUS_M, 1e3 * CAMERA_M), "give metres, not millimetres"),
        (f"{TRUS}\n0,0,0\n", "the columns camera_x_m, camera_y_m, camera_z_m are missing, or left_x_px"),
        (f"{CAMERA}\n0,0,0\n", "the columns trus_x_m, trus_y_m, trus_z_m are missing; add them, or name the searches"),
        (f"{TRUS},camera_x_m\n0,0,0,0\n", "the columns camera_y_m and camera_z_m are missing beside"),
        (f"{TRUS},{CAMERA}\n0,0,0,0,0,a\n", "line 2: camera_z_m is 'a', it must be a number"),
        (f"{TRUS},{CAMERA}\n", "0 points in DaVinci"),
        (f"{TRUS},{CAMERA}\n0,0,0,0,0,1e300\n", "line 2: camera_z_m is 1e+300, it must lie within ± 1e+06"),
        (
            f"{TRUS},{CAMERA},trus_sigma_m\n0,0,0,0,0,0,1e-4\n",
            "line 1: the column trus_sigma_m is unknown; name a standard deviation trus_sigma_x_m, trus_sigma_y_m, ",
        ),
        (f"name,{TRUS},{CAMERA}\na,0,0,0,0,0,1\na,0,0,0,0,0,1\n", "line 3: there are two points named a"),
        (
            f"{TRUS},{CAMERA},camera_sigma_x_m,camera_sigma_y_m,camera_sigma_z_m\n0,0,0,0,0,0,1e-4,0,1e-4\n",
            "line 2: camera_sigma_y_m is 0.0, a standard deviation must be above 0",
        ),
    ],
)
def test_tables_that_cannot_be_used_are_refused(shell: Shell, tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "p.csv"
    file.write_text(text, encoding="utf-8")
    code, out, err = shell("register", file, "--json")
    assert code == 2
    assert words in json.loads(out)["error"]
    assert words.split(";", maxsplit=1)[0] in " ".join(err.split())


def test_a_point_that_does_not_fit_is_named_and_nothing_is_registered(shell: Shell, tmp_path: Path) -> None:
    code, out, _ = shell("register", table(tmp_path / "p.csv", changed(3, 0, 10e-3)), "--json")
    report = json.loads(out)
    assert code == 3
    assert (report["registered"], report["davinci_to_trus"], report["worst"]) == (False, None, "4")
    assert "(FRE 10.03 mm, 1.41 mm expected); point 4 fits worst: check" in report["reason"]
    assert report["reason"].endswith("or leave it out of the registration")
    _, out, _ = shell("register", tmp_path / "p.csv")
    assert "or leave it out of the registration (--without)" in " ".join(out.split())
    code, out, _ = shell("register", tmp_path / "p.csv", "--json", "--without", 4)
    report = json.loads(out)
    assert (code, report["registered"], report["without"]) == (0, True, ["4"])
    assert [point["name"] for point in report["points"]] == list("12356")
    code, out, _ = shell("register", tmp_path / "p.csv", "--without", 9, "--json")
    assert code == 2
    assert "--without is '9', which is no point; there are 1, 2, 3" in json.loads(out)["error"]


def test_a_mirror_image_that_fits_better_is_reported(shell: Shell, tmp_path: Path) -> None:
    code, out, _ = shell("register", table(tmp_path / "p.csv", TRUS_M, CAMERA_M * [-1, 1, 1]), "--json")
    report = json.loads(out)
    assert code == 3
    assert "a mirror image fits better" in report["reason"]
    assert "point" in report["reason"]
    assert report["mirror_image_fre_m"] < 1e-6


def test_markers_come_from_journals_and_results_of_searches(shell: Shell, tmp_path: Path) -> None:
    camera = np.array([[-0.02, -0.02, 0.1], [0.02, -0.02, 0.1], [0.0, 0.02, 0.103]])
    file = tmp_path / "camera.csv"
    file.write_text(rows(CAMERA, camera), encoding="utf-8")
    searches = []
    markers = []
    for seed, kind in ((1, "journal"), (2, "json"), (3, "journal")):
        path = tmp_path / f"{seed}.{kind}"
        kept = ["--journal", path] if kind == "journal" else ["--no-journal"]
        _, out, _ = shell("search", "--seed", seed, "--json", *kept)
        if kind == "json":
            path.write_text(out, encoding="utf-8")
        markers.append(json.loads(out)["marker_trus_m"])
        searches += ["--journal", path]
    # The camera points are none of these markers: the command reads them, and says that they do not fit.
    code, out, _ = shell("register", file, *searches, "--json")
    report = json.loads(out)
    assert code == 3
    assert [point["trus_m"] for point in report["points"]] == markers
    code, out, _ = shell("register", file, *searches[:4], "--json")
    assert code == 2
    assert "2 searches and 3 rows" in json.loads(out)["error"]


def test_pixels_are_triangulated_with_the_calibration_of_the_endoscope(shell: Shell, tmp_path: Path) -> None:
    stereo = Path(__file__).parents[2] / "examples" / "stereo.toml"
    left, right = endoscope().project(CAMERA_M)
    head = (
        f"{TRUS},trus_sigma_x_m,trus_sigma_y_m,trus_sigma_z_m,left_x_px,left_y_px,right_x_px,right_y_px,spot_sigma_px"
    )
    file = tmp_path / "pixels.csv"
    columns = [TRUS_M, np.full((6, 3), 5e-5), left, right, np.full((6, 1), 0.06)]
    file.write_text(rows(head, *columns), encoding="utf-8")
    code, out, _ = shell("register", file, "--cameras", stereo, "--json")
    report = json.loads(out)
    assert code == 0
    assert report["weights"] == "sigmas of both"
    np.testing.assert_allclose(np.array(report["davinci_to_trus"])[:3, 3], MOVE_M, atol=1e-6)
    assert 0.5e-3 < report["expected_fre_m"] < 1.2e-3
    # Most of it is the focal length, which no point shows.
    assert 0.4e-3 < report["tre_m"] < 0.7e-3
    names = [error["name"] for error in report["shared"]]
    assert names == ["focal length", "vergence", "base", "sound speed", "face radius", "zero of the angle"]
    for words, said in (
        (("--cameras", EXAMPLE), "is not valid TOML"),
        ((), "it has pixels; name the calibration of the endoscope by --cameras FILE"),
    ):
        code, out, _ = shell("register", file, *words, "--json")
        assert code == 2
        assert said in json.loads(out)["error"]
    code, out, _ = shell("register", EXAMPLE, "--cameras", stereo, "--json")
    assert "--cameras needs the columns left_x_px" in json.loads(out)["error"]


def test_a_stated_depth_takes_camera_points_for_spots_above_the_sources(shell: Shell, tmp_path: Path) -> None:
    spots_m = CAMERA_M - 1e-3 * CAMERA_M / np.linalg.norm(CAMERA_M, axis=1, keepdims=True)
    sigmas = ",".join(f"{frame}_sigma_{axis}_m" for frame in ("trus", "camera") for axis in "xyz")
    file = tmp_path / "spots.csv"
    file.write_text(rows(f"{TRUS},{CAMERA},{sigmas}", TRUS_M, spots_m, np.full((6, 6), 5e-5)), encoding="utf-8")
    for depth in ((), ("--spot-depth-mm", 0, 0)):
        report = json.loads(shell("register", file, "--json", "--force", *depth)[1])
        away_m = np.array(report["davinci_to_trus"])[:3, 3] - MOVE_M
        # The spots are nearer to the camera, which also makes their pattern 1 % smaller.
        assert 0.5e-3 < np.linalg.norm(away_m) < 1.5e-3
        assert "depth of the source" not in [error["name"] for error in report["shared"]]
    exact, unsure = (
        json.loads(shell("register", file, "--json", "--force", "--spot-depth-mm", 1, sigma)[1]) for sigma in (0, 0.5)
    )
    np.testing.assert_allclose(np.array(exact["davinci_to_trus"])[:3, 3], MOVE_M, atol=1e-6)
    np.testing.assert_allclose(np.array(unsure["davinci_to_trus"])[:3, 3], MOVE_M, atol=1e-6)
    assert 1.05 * exact["tre_m"] < unsure["tre_m"] < np.hypot(exact["tre_m"], 0.5e-3)
    said = next(error for error in unsure["shared"] if error["name"] == "depth of the source")
    assert said["assumed_sigma"] == pytest.approx(0.5)
    code, out, _ = shell("register", file, "--json", "--spot-depth-mm", -1, 0.3)
    assert code == 2
    assert "depth_m is -0.001" in json.loads(out)["error"]


def test_a_search_without_a_position_says_how_to_calibrate(shell: Shell, tmp_path: Path) -> None:
    _, out, _ = shell("search", "--seed", 1, "--no-journal", "--json")
    for changes, words in (
        ({"marker_trus_m": None, "marker_sigma_m": None}, "markerseek calibrate point.hdf5', put face_radius_m into"),
        ({"found": False, "answer": "not found", "reason": "noise"}, "its search found no marker (not found: noise)"),
        (
            {"found": False, "answer": "unsure", "reason": "another source", "doubt": "source"},
            "its search found no marker (unsure: another source)",
        ),
        ({"marker_trus_m": "x"}, "the journal of a search or its result as JSON is expected, and this is none"),
    ):
        result = tmp_path / "result.json"
        result.write_text(json.dumps(json.loads(out) | changes), encoding="utf-8")
        file = tmp_path / "camera.csv"
        file.write_text(f"{CAMERA}\n0,0,0.1\n", encoding="utf-8")
        code, said, _ = shell("register", file, "--journal", result, "--json")
        assert code == 2
        assert words in json.loads(said)["error"]


def test_a_search_that_is_unsure_for_its_width_only_is_taken(shell: Shell, tmp_path: Path) -> None:
    _, out, _ = shell("search", "--seed", 1, "--no-journal", "--json")
    unsure = {"found": False, "answer": "unsure", "reason": "wide", "doubt": "width"}
    searches: list[object] = []
    for number, marker_m in enumerate(TRUS_M[:4].tolist()):
        path = tmp_path / f"{number}.json"
        path.write_text(json.dumps(json.loads(out) | unsure | {"marker_trus_m": marker_m}), encoding="utf-8")
        searches += ["--journal", path]
    (tmp_path / "camera.csv").write_text(rows(CAMERA, CAMERA_M[:4]), encoding="utf-8")
    code, said, _ = shell("register", tmp_path / "camera.csv", *searches, "--json")
    assert code == 0
    np.testing.assert_allclose(np.array(json.loads(said)["davinci_to_trus"])[:3, 3], MOVE_M, atol=1e-6)


def spots_in_folders(folder: Path, points_m: np.ndarray, names: list[str]) -> tuple[Path, Path]:
    """Images of both simulated cameras of a spot at each point."""
    cameras = endoscope()
    settings = EndoscopeSettings(frames=5)
    rng = np.random.default_rng(1)
    for side, places in zip(("left", "right"), cameras.project(points_m), strict=True):
        for name, place in zip(names, places, strict=True):
            (folder / side / name).mkdir(parents=True)
            for number, image in enumerate(
                spot_images(place, size_px=cameras.left.size_px, settings=settings, rng=rng)
            ):
                assert cv2.imwrite(str(folder / side / name / f"{number}.png"), image)
    return folder / "left", folder / "right"


def test_images_of_both_cameras_end_as_their_pixels_do(shell: Shell, tmp_path: Path) -> None:
    stereo = Path(__file__).parents[2] / "examples" / "stereo.toml"
    names = ["a", "b", "c"]
    journals = []
    for seed, name in enumerate(names, start=1):
        journals += ["--journal", tmp_path / f"{name}.journal"]
        shell("search", "--seed", seed, "--json", *journals[-2:])
    camera_m = np.array([[-0.02, -0.02, 0.1], [0.02, -0.02, 0.1], [0.0, 0.02, 0.103]])
    left, right = spots_in_folders(tmp_path, camera_m, names)
    # In any order: each is known by its name.
    words = ["--cameras", stereo, *journals[2:], *journals[:2], "--json"]
    _, out, _ = shell("register", "--frames", left, right, *words)
    by_images = json.loads(out)
    assert [point["name"] for point in by_images["points"]] == names
    places = [[find_spot(read_camera_images(side / name)) for side in (left, right)] for name in names]
    lines = ["name,left_x_px,left_y_px,right_x_px,right_y_px,spot_sigma_px"]
    for name, (one, other) in zip(names, places, strict=True):
        sigma_px = max(one.sigma_px, other.sigma_px)
        lines.append(f"{name},{one.x_px},{one.y_px},{other.x_px},{other.y_px},{sigma_px}")
    pixels = tmp_path / "pixels.csv"
    pixels.write_text("\n".join(lines), encoding="utf-8")
    usual = ("--spot-depth-mm", 0.3, 0.3)
    _, out, _ = shell("register", pixels, "--cameras", stereo, *journals, *usual, "--json")
    assert by_images["points"] == json.loads(out)["points"]
    for point, true_m in zip(by_images["points"], camera_m, strict=True):
        assert np.linalg.norm(np.array(point["camera_m"]) - true_m) < 1e-3
    for data, said in (
        (cv2.imencode(".png", np.zeros((130, 130), np.uint16))[1].tobytes(), "pixels of uint16, they must have 8 bits"),
        (b"no image", "0.png: it cannot be read as an image: it is cut off, or no PNG"),
    ):
        (left / "a" / "0.png").write_bytes(data)
        code, out, _ = shell("register", "--frames", left, right, *words)
        assert (code, said in json.loads(out)["error"]) == (2, True)
    for change, said in (
        (["--frames", left, tmp_path / "none", *words], "is no folder"),
        (["--frames", left, right, "--cameras", stereo, *journals[:4], "--json"], "--journal names a, b; give each"),
        (["--frames", left, right, *journals, "--json"], "name the calibration of the endoscope"),
        ([pixels, "--frames", left, right, *words], "both give points"),
        ([pixels, "--calibration-sigma-px", 0.2, *journals, "--json"], "belongs to a calibration"),
    ):
        code, out, _ = shell("register", *change)
        assert (code, said in json.loads(out)["error"]) == (2, True)
    for path in (left / "a").iterdir():
        if path.stem in "012":
            path.unlink()
    code, out, _ = shell("register", "--frames", left, right, *words)
    assert (code, "save at least 3" in json.loads(out)["error"]) == (2, True)


def test_a_whole_registration_on_the_simulated_rig(shell: Shell) -> None:
    code, out, _ = shell(
        "register", "--simulate", "--sweep", "--markers", 3, "--seed", 2, "--record", "first", "--json"
    )
    report = json.loads(out)
    assert (code, report["decided"], report["left_out"]) == (0, True, [])
    matrix = np.array(report["davinci_to_trus"])
    for point in report["points"]:
        there_m = np.linalg.inv(matrix) @ [*point["camera_m"], 1.0]
        assert np.linalg.norm(there_m[:3] - point["trus_m"]) > 10e-3
    simulation = report["simulation"]
    assert simulation["simulated"] is True
    assert max(simulation["marker_errors_m"].values()) < 0.3e-3
    assert simulation["target_error_m"] < 2 * report["tre95_m"] < 10e-3
    assert 10 < report["rig_s"] < 90
    assert read_registration(Path("first") / "registration.json").simulated
    assert not Path("registration.json").exists()
    assert simulation["by_hand_s"] == [120, 420]


@pytest.mark.long
def test_a_session_without_frames_has_the_samples_and_is_continued_with_another_goal(shell: Shell) -> None:
    given = ("register", "--simulate", "--sweep", "--seed", 12)
    code, _, err = shell(*given, "--markers", 3, "--record", "s", "--no-frames")
    size = sum(path.stat().st_size for path in Path("s").iterdir())
    assert (code, size < 8e6) == (0, True), err
    assert f"the record has {size / 1e6:.3g} MB, no frames" in err
    for name in ("1", "2", "3"):
        recorded = read_journal(Path("s", f"{name}.journal"))
        assert not recorded.configuration.frames
        samples = [entry.event.sample for entry in recorded.entries if isinstance(entry.event, Measured)]
        assert samples
        assert {sample.frame for sample in samples} == {None}
    code, out, _ = shell("journal", "replay", "s/1.journal", "--json")
    again = json.loads(out)
    assert (again["from_the_frames"], again["from_the_samples"]) == (None, again["recorded"])
    # Above a goal that no marker reaches: registered, and not reached.
    code, out, err = shell(*given, "--markers", 4, "--tre-mm", 0.05, "--continue", "s")
    assert code == 0
    assert "registered above the goal of 0.05 mm: simulated rig and endoscope, 4 points" in " ".join(out.split())
    assert "the receiver's frames for the most part: --no-frames keeps the samples only" in " ".join(err.split())
    assert read_journal(Path("s", "4.journal")).configuration.frames


def test_a_session_whose_marker_has_moved_is_not_registered_however_often_it_is_continued(shell: Shell) -> None:
    record = sessions.begin(Path("s"), markers=4)
    # As a session of 0.4 that was continued: it said "registered" again.
    for step in (sessions.MOVED, sessions.ENDED, sessions.registered(4), sessions.ENDED):
        record.add(step)
    record.close()
    Path("s", "registration.json").write_text("{}", encoding="utf-8")
    for _ in range(2):
        code, out, _ = shell("register", "--simulate", "--continue", "s", "--json")
        report = json.loads(out)
        assert code == 3
        assert (report["registered"], report["decided"], report["davinci_to_trus"]) == (False, False, None)
        assert report["reason"] == "marker 1 has moved"
        assert not Path("s", "registration.json").exists()
    code, out, _ = shell("register", "--simulate", "--continue", "s")
    assert (code, "not registered" in out, "marker 1 has moved" in out) == (3, True, True)
    for path in ("s", "s/session.jsonl", "s/registration.json"):
        code, _, err = shell("igtl", "--port", 0, "--registration", path)
        assert code == 2
        assert "without a registration that holds (marker 1 has moved); register again" in " ".join(err.split())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["register"], "a rig for a session by --rig RIG.toml, or add --simulate"),
        (
            ["register", EXAMPLE, "--sweep"],
            "--sweep is for a session; add --rig RIG.toml or --simulate, or leave it out",
        ),
        (
            ["register", "--simulate", "--spot-depth-mm", 0.3, 0.3],
            "a session takes the depth of [spot] from its rig file",
        ),
        (["register", EXAMPLE, "--simulate"], "a session makes its own points; leave the CSV"),
        (["register", "--simulate", "--images", "a b"], "the simulated rig has a simulated endoscope"),
        (["register", EXAMPLE, "--tissue", "liver"], "--tissue is for a session"),
        (["register", "--simulate", "--trace", "lines.txt"], "--trace is for a rig of devices"),
        (["register", EXAMPLE, "--trace", "lines.txt"], "--trace is for a session"),
        (["calibrate", "--delay", "--trace", "lines.txt"], "--trace is for a rig of devices"),
        (["calibrate", EXAMPLE, "--trace", "lines.txt"], "--rig, --arm and --trace belong to --delay"),
        (["register", EXAMPLE, "--no-frames"], "--no-frames is for a session"),
        (["register", "--simulate", "--tre-mm", 40], "--tre-mm is 40.0 mm, it must lie in [0.01, 20] mm"),
        (["register", "--simulate", "--markers", 2], "--markers is 2, it must be a whole number from 3 to 12"),
        (["register", EXAMPLE, "--target-mm", 0, "nan", 0], "must be finite"),
    ],
)
def test_options_that_do_not_go_together_are_refused(shell: Shell, words: list[object], said: str) -> None:
    code, out, _ = shell(*words, "--json")
    assert code == 2
    assert said in json.loads(out)["error"]


def test_a_session_that_has_ended_is_checked_by_one_more_spot(shell: Shell) -> None:
    given = ("register", "--simulate", "--sweep", "--seed", 2, "--no-frames")
    code, out, _ = shell(*given, "--markers", 3, "--record", "s", "--json")
    first = json.loads(out)
    assert (code, first["checks"]) == (0, [])
    code, out, err = shell(*given, "--markers", 3, "--continue", "s", "--check")
    assert code == 0
    assert "check-1: off by " in err
    assert "check-1" in out
    report = json.loads(Path("s", "registration.json").read_bytes())
    [check] = report["checks"]
    assert report["davinci_to_trus"] == first["davinci_to_trus"]
    assert np.linalg.norm(np.subtract(check["transformed_m"], check["trus_m"])) == pytest.approx(check["off_m"])
    assert min(np.linalg.norm(np.subtract(check["camera_m"], each["camera_m"])) for each in report["points"]) > 5e-3
    assert check["off_m"] < 2 * check["expected95_m"] < 10e-3
    # Another check has another name; the first one stays.
    code, out, _ = shell(*given, "--markers", 3, "--continue", "s", "--check", "--json")
    assert [each["name"] for each in json.loads(out)["checks"]] == ["check-1", "check-2"]


def test_the_sessions_of_a_folder_are_listed(shell: Shell) -> None:
    record = sessions.begin(Path("kept", "a"), markers=4)
    record.add(sessions.ENDED)
    record.close()
    code, out, _ = shell("register", "--list", "kept", "--json")
    [listed] = json.loads(out)["sessions"]
    assert (code, listed["markers"], listed["registered"], listed["phase"]) == (0, 0, True, "ended")
    code, out, _ = shell("register", "--list", "kept")
    text = " ".join(out.split())
    assert code == 0
    assert f"expected error {1e3 * listed['tre_m']:.2f} mm (95 %: {1e3 * listed['tre95_m']:.2f})" in text
    assert "1 session in kept, 0.0 MB" in text
    code, out, _ = shell("register", "--list", "nowhere", "--json")
    assert (code, json.loads(out)["error"].startswith("nowhere: there is no such folder")) == (2, True)
    assert shell("register", "--list", "--simulate")[0] == 2
    # Before the first session there is no folder of them.
    assert json.loads(shell("register", "--list", "--json")[1])["sessions"] == []


def test_the_report_of_a_session_says_what_was_left_out_and_shows_the_markers_in_the_images(
    shell: Shell, tmp_path: Path
) -> None:
    cameras = StereoSettings.of(endoscope(), calibration_sigma_px=0.2)
    folder = tmp_path / "s"
    record = SessionRecord.create(folder, structs.replace(sessions.BEGUN, cameras=camera_text(cameras)))
    grey = np.full((1024, 1280), 90, np.uint8)
    record.keep_pair("1", StereoPair(left=grey, right=grey, at_s=0.0))
    record.add(sessions.taken("1", reason="nothing above the threshold"))
    record.add(SpotRefused(name="2", reason="two places are about as bright <here>"))
    record.add(sessions.registered(4))
    record.add(sessions.ENDED)
    record.close()
    code, out, _ = shell("register", "--report", folder, "--json")
    made = json.loads(out)
    assert (code, made["session"]) == (0, str(folder))
    page = (folder / "report.html").read_text(encoding="utf-8")
    report = sessions.registered(4).report
    for part in (
        "Simulated: this is no measurement on hardware.",
        f"{1e3 * report.tre_m:.2f} mm, in 95 % below {1e3 * report.tre95_m:.2f} mm",
        "the search found no marker: nothing above the threshold",
        "two places are about as bright &lt;here&gt;",
        "--child-frame-id simulated_davinci_camera_optical",
        "markerseek 0.",
        "Spots of the markers over the images of both cameras",
    ):
        assert part in page, part
    assert page.count("data:image/png") == 3
    assert (folder / "report.pdf").read_bytes().startswith(b"%PDF")
    code, out, _ = shell("register", "--report", folder, "--out", tmp_path / "elsewhere")
    assert code == 0
    assert {each.name for each in (tmp_path / "elsewhere").iterdir()} == {"report.html", "report.pdf"}
    code, out, _ = shell("register", "--report", tmp_path / "nowhere", "--json")
    assert (code, "it is no folder of a session" in json.loads(out)["error"]) == (2, True)
