"""`markerseek bank` and banks in `replay` and `frame`, as a user types them: results, round trips, and wrong usage."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
from contextlib import closing
from pathlib import Path

import h5py
import numpy as np
import pacfish
import pytest

from markerseek import runs
from markerseek.cli.signals import StoppedBySignal
from markerseek.core import Measured, RecordError
from markerseek.records.banks import read_bank, record_of
from markerseek.records.journal import read_journal
from tests.emulated import ran

SCAN = ("--seed", 3, "--step-deg", 5, "--wavelength-nm", 760)


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    path = tmp_path_factory.mktemp("scan") / "scan.hdf5"
    ended = ran("bank", "scan", path, *SCAN, "--json")
    assert ended.returncode == 0, ended.stderr
    report = json.loads(ended.stdout)
    assert (report["angles"], report["dark_frames"], report["simulated"], report["refused"]) == (15, 3, True, 0)
    return path


def replayed(shell, path, *words):
    code, out, err = shell("replay", path, "--method", "golden-section", "--as-published", "--json", *words)
    assert code in (0, 3), err
    return json.loads(out)


def test_a_scan_holds_the_whole_range_and_what_is_known(shell, scan):
    code, out, _ = shell("bank", "info", scan, "--json")
    info = json.loads(out)
    assert (code, info["angles"], info["dark_frames"]) == (0, 15, 3)
    assert info["first_deg"] == pytest.approx(-35, abs=0.01)
    assert info["last_deg"] == pytest.approx(35, abs=0.01)
    assert info["largest_step_deg"] == pytest.approx(5, abs=0.01)
    assert (info["wavelength_m"], info["probe"], info["sampling_hz"]) == (pytest.approx(760e-9), "BPL9-5/55", 40e6)
    assert abs(info["max_deg"] - info["reference_deg"]) <= 2.6
    assert 0 < info["dark_intensity"] < info["max_intensity"]
    assert "simulated" in info["description"]


def test_a_frame_that_has_changed_is_found_by_every_command_and_nothing_is_left_behind(shell, scan, tmp_path):
    damaged = tmp_path / "damaged.hdf5"
    shutil.copyfile(scan, damaged)
    with h5py.File(damaged) as file:
        frames = file["binary_time_series_data"].id
        places = [frames.get_chunk_info_by_coord((0, 0, 0, row)).byte_offset for row in (2, 9)]
    raw = bytearray(damaged.read_bytes())
    for place in places:
        raw[place + 1000] ^= 1
    damaged.write_bytes(raw)
    for words in (
        ("bank", "info", damaged),
        ("bank", "export", damaged, tmp_path / "out.csv"),
        ("bank", "export", damaged, tmp_path / "o.igs.mha"),
        ("bank", "import", damaged, tmp_path / "whole.hdf5"),
        ("replay", damaged, "--method", "exhaustive", "--as-published"),
    ):
        code, out, err = shell(*words)
        assert (code, out, err.count("error:")) == (2, "", 1)
        assert re.search(
            "no frame at .* deg that can be read: .*; it has changed since it was written",
            " ".join(err.split()),
        )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["damaged.hdf5"]
    (tmp_path / "damaged.hdf5").write_bytes(scan.read_bytes()[:9999])
    code, _, err = shell("bank", "info", damaged)
    assert (code, err.count("error:")) == (2, 1)


def test_a_name_that_is_no_unicode_is_escaped_in_json(shell, tmp_path):
    bank = tmp_path / "odd\udcff.csv"
    bank.write_text("angle_deg,intensity\n0,1\n1,2\n2,1\n")
    for words in (("info", bank), ("export", bank, tmp_path / "again\udcff.csv")):
        code, out, err = shell("bank", *words, "--json")
        assert (code, json.loads(out)["path"].endswith("\\udcff.csv")) == (0, True), err


def test_a_table_becomes_a_bank_and_the_search_is_the_same(shell, tmp_path):
    source = Path("examples/simulated_scan.csv")
    code, out, err = shell("bank", "import", source, tmp_path / "a.hdf5", "--reference-deg", 1.5)
    assert code == 0, err
    assert read_bank(tmp_path / "a.hdf5").facts.reference_angle_deg == 1.5
    assert "intensities only, no channel data; markerseek and pacfish read it" in " ".join(out.split())
    np.testing.assert_array_equal(
        pacfish.load_data(str(tmp_path / "a.hdf5")).get_custom_meta_datum("intensity"), read_bank(source).intensities
    )
    assert replayed(shell, tmp_path / "a.hdf5")["angle_deg"] == replayed(shell, source)["angle_deg"]
    code, _, err = shell("bank", "export", tmp_path / "a.hdf5", tmp_path / "a.csv")
    assert code == 0, err
    assert read_bank(tmp_path / "a.csv").intensities == read_bank(source).intensities


@pytest.mark.parametrize(
    ("after", "number", "by"), [(1, signal.SIGINT, "the user"), (3, signal.SIGTERM, "another program (SIGTERM)")]
)
def test_a_scan_that_is_stopped_says_what_is_kept(shell, tmp_path, monkeypatch, after, number, by):
    """A bank of the angles that were measured; of too few for a bank, the record."""
    path = tmp_path / "a.hdf5"
    whole = runs.scan_bank

    def stopped(*arguments, **named):
        with closing(whole(*arguments, **named)) as events:
            for event in events:
                yield event
                if isinstance(event, Measured) and event.index == after and not event.sample.dark:
                    raise StoppedBySignal(number)

    monkeypatch.setattr(runs, "scan_bank", stopped)
    code, out, err = shell("bank", "scan", path, "--json")
    kept = record_of(path) if after == 1 else path
    assert (code, json.loads(out)["error"], json.loads(out)["kept"]) == (128 + number, f"stopped by {by}", str(kept))
    assert "the laser is disarmed" in err
    if after == 1:
        assert angles_in(kept) == 1
    else:
        assert len(read_bank(path).angles_deg) == 3
        assert "holds 3 of 141 angles" in err


def angles_in(path):
    try:
        return sum(
            isinstance(each.event, Measured) and not each.event.sample.dark for each in read_journal(path).entries
        )
    except RecordError:
        return 0


def test_a_killed_scan_becomes_a_bank_or_is_continued_to_the_whole_one(shell, scan, tmp_path):
    killed = tmp_path / "killed.hdf5"
    words = ("bank", "scan", killed, *SCAN)
    ended = ran(*words, before=KILLED)
    assert ended.returncode == -signal.SIGKILL, ended.stderr
    record = record_of(killed)
    assert [path.name for path in tmp_path.iterdir()] == [record.name]
    code, _, err = shell(*words)
    assert (code, "it holds a scan that was killed" in err) == (2, True)
    whole = read_bank(scan)
    code, _, err = shell("bank", "import", record, tmp_path / "part.hdf5")
    assert code == 0, err
    part = read_bank(tmp_path / "part.hdf5")
    assert part.angles_deg == whole.angles_deg[:9]
    code, _, err = shell(*words, "--continue")
    assert code == 0, err
    bank = read_bank(killed)
    assert np.allclose(bank.angles_deg, whole.angles_deg, atol=0.02)
    assert not record.exists()
    # What was measured before is kept as it was; the other angles are new acquisitions of the same scene.
    assert bank.intensities[:9] == part.intensities == whole.intensities[:9]
    assert np.allclose(bank.intensities[9:], whole.intensities[9:], rtol=0.2)
    for index in range(9):
        np.testing.assert_array_equal(bank.frame(index).samples, whole.frame(index).samples)
    assert pacfish.load_data(str(killed)).binary_time_series_data.shape[3] == 15


KILLED = """
import os, signal
from unittest import mock
from markerseek import runs
from markerseek.core import Measured
scan = runs.scan_bank
def killed(*given, **named):
    taken = 0
    for event in scan(*given, **named):
        taken += isinstance(event, Measured)
        if taken == 12:
            os.kill(os.getpid(), signal.SIGKILL)
        yield event
mock.patch.object(runs, "scan_bank", killed).start()
"""


def test_frames_of_the_public_data_set_are_imaged_by_their_own_probe(shell, tmp_path):
    usual = Path(__file__).parents[2] / "../shared/data/pa-point-source"
    frames = sorted(Path(os.environ.get("MARKERSEEK_REAL_FRAMES", usual)).glob("waterbath*.mat"))[:3]
    if len(frames) < 3:
        pytest.skip("the public data set is not beside the checkout")
    for number, frame in enumerate(frames):
        (tmp_path / "scan").mkdir(exist_ok=True)
        (tmp_path / "scan" / f"angle_{number}.mat").symlink_to(frame.absolute())
    code, _, err = shell("bank", "import", tmp_path / "scan", tmp_path / "a.hdf5")
    assert (code, "40 MHz is assumed" in err, "does not name its probe" in err) == (0, True, False)
    info = json.loads(shell("bank", "info", tmp_path / "a.hdf5", "--json")[1])
    one = json.loads(shell("frame", frames[round(info["max_deg"])], "--json")[1])
    assert info["probe"] == "L3-8"
    assert info["max_intensity"] == pytest.approx(one["intensity"], rel=1e-6)
    again = ("bank", "import", tmp_path / "a.hdf5", tmp_path / "b.hdf5", "--sampling-mhz")
    code, _, err = shell(*again, 20)
    assert (code, "--sampling-mhz is 20, and" in err, "says 40 MHz" in err) == (2, True, True)
    assert shell(*again, 40)[0] == 0


WRONG = [
    (("bank", "scan", "nowhere/a.hdf5"), "there is no folder nowhere; make it, or name another"),
    (("bank", "export", "good.csv", ".csv"), "the name must end in one of"),
    (("bank", "scan", "a.txt"), r"must end in .hdf5 or .h5"),
    (("bank", "scan", "a.hdf5", "--wavelength-nm", -1), "--wavelength-nm is -1, it must be positive and at most 20000"),
    (("bank", "info", "a.csv"), "the column intensity is missing"),
    (("bank", "info", "broken.hdf5"), "no bank in HDF5 that can be read"),
    (("bank", "import", "good.csv", "b.hdf5", "--probe", "L3-8"), "--probe is L3-8, and good.csv holds intensities"),
    (("bank", "export", "good.csv", "b.igs.mha", "--face-radius-mm", 1), "--face-radius-mm is 1.0, and good.csv holds"),
    (("bank", "export", "good.csv", "b.csv", "--face-radius-mm", 10), "--face-radius-mm is for .igs.mha and .zea.hdf5"),
    (
        ("bank", "import", "good.csv", "b.hdf5", "--first-deg", 0, "--step-deg", 1),
        "its column angle_deg has the angles",
    ),
    (("bank", "import", "frames.npy", "b.hdf5"), "state the first angle and the step, --first-deg -35 --step-deg 0.5"),
    (("bank", "import", "frames.npy", "b.hdf5", "--first-deg", 0), "go together"),
    (("bank", "import", "frames.npy", "b.hdf5", "--first-deg", 0, "--step-deg", 0), "a step not 0"),
    (("bank", "import", "frames.npy", "b.hdf5", "--first-deg", 0, "--step-deg", 1), "has 128"),
    (
        ("bank", "import", "frames.npy", "b.hdf5", "--first-deg", 0, "--step-deg", 1, "--first-frame", 1),
        "a first frame is for the receive buffer of a Verasonics workspace",
    ),
    (("bank", "import", "good.csv", "b.hdf5", "--sampling-mhz", 4e7), "at most 1000; check the unit"),
    (("bank", "export", "good.csv", "b.igs.mha"), "intensities and no frames"),
    (("bank", "export", "good.csv", "b.csv", "--face-radius-mm", -1), "--face-radius-mm is -1"),
    (("frame", "a.b8"), "B-mode images (.b8) are for 'markerseek tooltip'"),
    (("frame", "good.csv"), "a scan of many angles, not one frame"),
    (("frame", "frames.npy", "--number", 2), "--number: frames.npy holds one frame; leave it out"),
    (("replay", "good.csv", "--probe", "X1"), "probe 'X1' is not known"),
]


@pytest.mark.parametrize(("words", "sentence"), WRONG, ids=[" ".join(map(str, words)) for words, _ in WRONG])
def test_wrong_usage_is_a_sentence_and_exit_2(shell, tmp_path, monkeypatch, words, sentence):
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text("angle_deg,height,x\n1,2,3\n")
    Path("good.csv").write_text("angle_deg,intensity\n1,2\n2,3\n3,1\n")
    Path("broken.hdf5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    Path("a.b8").write_bytes(bytes(100))
    np.save("frames.npy", np.zeros((4, 2, 3000), np.int16))
    code, _, err = shell(*words)
    assert code == 2
    assert sentence in " ".join(err.split())
    assert "Traceback" not in err


@pytest.mark.parametrize(("level", "marker_deg"), [(600.0, -12.25), (90.0, 17.0)])
def test_the_peak_of_a_bank_is_above_the_background_and_without_outliers_as_its_answer(
    shell, tmp_path: Path, level: float, marker_deg: float
) -> None:
    rng = np.random.default_rng(7)
    angles = np.arange(-35.0, 35.5, 0.5)
    curve = 300.0 * np.exp(-((angles - marker_deg) ** 2) / (2 * 2.2**2))
    intensities = level + curve + rng.normal(0.0, 2.0, angles.size)
    outlier = int(np.flatnonzero(angles == 0.0)[0])
    intensities[outlier] = 40.0 * level
    table = tmp_path / "scan.csv"
    rows = [f"{angle:g},{value:.3f}" for angle, value in zip(angles, intensities, strict=True)]
    table.write_text("\n".join(["angle_deg,intensity", *rows]) + "\n")
    code, out, _ = shell("bank", "info", table, "--json")
    said = json.loads(out)
    assert (code, said["answer"]) == (0, "found")
    assert said["background"] == pytest.approx(level, rel=0.05)
    assert said["outliers_deg"] == [0.0]
    for name in ("angle_deg", "max_deg", "com_deg", "cen_deg"):
        assert said[name] == pytest.approx(marker_deg, abs=0.6), name
    # That of a Gaussian with this standard deviation.
    assert said["fwhm_deg"] == pytest.approx(2.3548 * 2.2, rel=0.1)
