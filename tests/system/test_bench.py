"""A whole rig of emulated devices, from the command line: pseudo-terminals, a folder, real drivers, real time."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek.cli import doctor
from markerseek.core import Measured
from markerseek.records.journal import Checked, RecordedRun, read_journal
from tests.emulated import fixed_bench, markerseek
from tests.waiting import wait_until

pytestmark = pytest.mark.real_time
pytest.importorskip("serial", reason="needs the extra devices")

Shell = Callable[..., tuple[int, str, str]]

METHOD = ("--method", "weighted-average", "--as-published", "--acquisitions", "8", "--json")
SEARCH = (*METHOD, "--no-journal")


def test_a_search_over_emulated_devices_measures_and_finds_what_the_simulation_does(
    shell: Shell, tmp_path: Path
) -> None:
    journal = tmp_path / "run.journal"
    with fixed_bench(tmp_path, seed=3) as devices:
        code, out, err = shell("search", "--rig", devices.rig, "--arm", *METHOD, "--journal", journal)
        low_deg, high_deg, pulses = devices.end()
    assert code == 0, err
    over_bytes = json.loads(out)
    _, out, _ = shell("search", "--rig", tmp_path / "world.toml", "--seed", 3, *SEARCH)
    simulated = json.loads(out)
    assert (over_bytes["rig"], over_bytes["truth_deg"], over_bytes["seed"]) == ("bench", None, None)
    assert (over_bytes["emulated"], json.loads(out)["emulated"]) == (["stage", "laser"], [])
    shown = json.loads(shell("journal", "show", journal, "--json")[1])
    assert shown["configuration"]["facts"]["emulated"] == ["stage", "laser"]
    assert "on a bench rig with emulated stage and laser: " in shell("journal", "show", journal)[1]
    assert "on a bench rig with emulated stage and laser: " in " ".join(shell("journal", "list", tmp_path)[1].split())
    plot = ("--plot", "--out", tmp_path)
    assert "on a bench rig with emulated stage and laser: " in shell("resume", journal, *plot)[1]
    page = (tmp_path / "resume.html").read_text(encoding="utf-8")
    assert "Emulated stage and laser: this is no measurement on hardware." in page
    # the same world, drawn from the same seed: every count of every frame is the same
    for name in ("angle_deg", "samples", "confirmation", "acquisitions", "refused", "marker_trus_m"):
        assert over_bytes[name] == simulated[name], name
    assert pulses == 16 * (over_bytes["acquisitions"] + 1)
    assert -36.5 <= low_deg <= min(sample["angle_deg"] for sample in over_bytes["samples"])
    assert max(sample["angle_deg"] for sample in over_bytes["samples"]) <= high_deg <= 36.5
    # the journal alone gives it again: no device is left
    code, out, err = shell("journal", "verify", journal, "--json")
    assert (code, json.loads(out)["ok"]) == (0, True), (out, err)
    again = json.loads(shell("journal", "replay", journal, "--json")[1])
    assert again["from_the_frames"]["angle_deg"] == pytest.approx(again["recorded"]["angle_deg"], abs=0.01)
    assert json.loads(shell("resume", journal, "--json")[1]) == over_bytes


@pytest.mark.long
def test_a_search_over_emulated_devices_is_resumed_after_kill_9(shell: Shell, tmp_path: Path) -> None:
    """The devices live on, as real ones do: what was measured is kept, one angle is checked, the rest is measured."""
    journal = tmp_path / "run.journal"
    with fixed_bench(tmp_path, seed=3) as devices:
        process = subprocess.Popen(
            markerseek("search", "--rig", devices.rig, "--arm", *METHOD, "--journal", journal),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        # a commit of a frame takes half a megabyte: five of the eight
        wait_until(
            lambda: process.poll() is not None or (journal.exists() and journal.stat().st_size > 5 * 2 * 128 * 2080)
        )
        process.kill()
        process.communicate()
        kept = read_journal(journal)
        before = [entry.event for entry in kept.entries if isinstance(entry.event, Measured)]
        code, out, _ = shell("resume", journal, "--json")
        assert (code, json.loads(out)["acquisitions"]) == (4, len(before))
        code, out, err = shell("resume", journal, "--arm", "--json")
        assert (code, "which is not taken from a journal" in err) == (2, True)
        code, out, err = shell(
            "resume", journal, "--rig", devices.rig, "--arm", "--json", "--trace", tmp_path / "lines.txt"
        )
        assert code in (0, 3), err
        assert "stage < " in (tmp_path / "lines.txt").read_text(encoding="utf-8")
        result = json.loads(out)
        low_deg, high_deg, pulses = devices.end()
    held = read_journal(journal)
    assert times_and_kinds(held)[: len(kept.entries)] == times_and_kinds(kept)
    assert [sample["angle_deg"] for sample in result["samples"]][: len(before)] == [
        each.sample.angle_deg for each in before
    ]
    assert result["refused"] == 0
    assert abs(result["angle_deg"] - 6.4) < 3
    checks = [entry.event for entry in held.entries if isinstance(entry.event, Checked)]
    assert [check.difference for check in checks] == [None] * len(checks) != []
    # those of the search, the confirmation and the checks, and what was under way when it died
    whole = 16 * (result["acquisitions"] + 1 + len(checks))
    assert whole <= pulses <= whole + 16
    assert -36.5 <= low_deg <= high_deg <= 36.5
    code, out, err = shell("journal", "verify", journal, "--json")
    assert (code, json.loads(out)["ok"]) == (0, True), (out, err)


def times_and_kinds(held: RecordedRun) -> list[tuple[float, str]]:
    return [(entry.clock_s, type(entry.event).__name__) for entry in held.entries]


def test_nothing_is_fired_unarmed_and_ctrl_c_stops_and_releases_everything(shell: Shell, tmp_path: Path) -> None:
    with fixed_bench(tmp_path, seed=4) as devices:
        bare = tmp_path / "bare.toml"
        bare.write_text(devices.rig.read_text().replace("lease_s = 1.0", "enabled = false"))
        for rig, said in ((bare, "WITHOUT a supervisor"), (devices.rig, "stands at 0.000 deg")):
            code, out, err = shell("search", "--rig", rig, *SEARCH)
            assert (code, json.loads(out)["armed"]) == (4, False)
            assert said in err
            assert "laser.wavelength_nm, laser.pulse_energy_j" in " ".join(err.split())
            assert "not armed: nothing moved and nothing was fired" in err
        kept = tmp_path / "run.journal"
        process = subprocess.Popen(
            markerseek("search", "--rig", devices.rig, "--arm", *METHOD, "--journal", kept),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        last = devices.rig.parent / "daq" / "CH127.daq"
        wait_until(lambda: last.exists() or process.poll() is not None)
        # Into the second move or acquisition.
        time.sleep(0.7)
        process.send_signal(signal.SIGINT)
        _, printed = process.communicate(timeout=60)
        assert process.returncode == 130, printed
        assert "stopped by the user: the laser is disarmed" in printed
        assert f"markerseek resume {kept} --rig {devices.rig}" in printed
        # the lines are free again, and the devices fit for another search
        code, out, err = shell("search", "--rig", devices.rig, "--arm", "--stay", *SEARCH)
        assert code in (0, 3), err
        low_deg, high_deg, pulses = devices.end()
    # besides those of the whole search: one or two acquisitions, the second perhaps cut short
    assert 16 <= pulses - 16 * json.loads(out)["acquisitions"] <= 48
    assert -36.5 <= low_deg <= high_deg <= 36.5


@pytest.mark.long
def test_the_doctor_looks_at_a_rig_s_devices_and_moves_nothing(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with fixed_bench(tmp_path, seed=1) as devices:
        code, out, _ = shell("doctor", "--rig", devices.rig, "--json")
        finding = json.loads(out)["findings"][-1]
        assert (code, finding["state"]) == (0, "ok")
        assert "KDC101 27000001 at" in finding["detail"]
        assert "stands at 0.000 deg, inside [-36.5, 36.5] deg" in finding["detail"]
        # Once is enough of the searches.
        monkeypatch.setattr(doctor, "_search", lambda _: doctor.CheckResult(what="", state="ok", detail=""))
        usual = devices.rig.read_text()
        for name, wrong in (
            ("age_s = 1.0", "age_s = 1.5"),
            ("begin_s = 5.0", "begin_s = 6.0"),
            ("answer_s = 5.0", "answer_s = 8.0"),
        ):
            devices.rig.write_text(usual.replace(name, wrong))
            _, out, _ = shell("doctor", "--rig", devices.rig, "--json")
            assert wrong.replace("=", "is") in out
        devices.rig.write_text(usual)
        assert devices.end() == (0.0, 0.0, 0)
    code, out, _ = shell("doctor", "--rig", devices.rig, "--json")
    finding = json.loads(out)["findings"][-1]
    assert (code, finding["state"]) == (1, "broken")
    assert "cannot be opened" in finding["detail"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("search", "--arm", "--tissue", "liver"),
            "--tissue liver: only for a simulated rig, and .*rig.toml is one of",
        ),
        (("search", "--arm", "--seed", "3", "--no-marker"), "--no-marker and --seed 3: only for a simulated rig"),
        (("search", "--arm"), "serial port /nowhere/laser cannot be opened|line .*cannot be opened|No such file"),
        (("bank", "scan", "scan.hdf5", "--seed", "1"), "--seed 1: only for a simulated rig"),
    ],
)
def test_options_and_ports_that_do_not_fit_are_refused_with_a_sentence(
    shell: Shell, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(
        'kind = "bench"\n[stage]\nport = "/nowhere/stage"\nzero_deg = 0.0\n[laser]\nport = "/nowhere/laser"\n'
        f'[receiver]\nfolder = "{tmp_path}"\n'
    )
    code, _, err = shell(*words, "--rig", rig)
    assert code in (1, 2)
    assert re.search(message, err), err
    assert not Path("scan.hdf5").exists()
