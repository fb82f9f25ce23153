"""The command that goes on with a session has the options with which it was begun."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from markerseek import registration
from markerseek.cli import registering
from markerseek.cli.registering import SessionOptions
from markerseek.core import ConfigError, DeviceError


def test_a_session_goes_on_with_the_options_it_was_begun_with() -> None:
    options = SessionOptions(rig=Path("my rig.toml"), images="left right", sweep=True, markers=5, arm=True)
    command = registering._continue_command(options, [Path("stereo.ini")], 0.25, (0.0, 0.001, 0.04), Path("kept"))
    assert command == (
        "markerseek register --rig 'my rig.toml' --images 'left right' --sweep --markers 5 --arm --cameras stereo.ini "
        "--calibration-sigma-px 0.25 --target-mm 0 1 40 --continue kept"
    )
    simulated = SessionOptions(simulate=True, seed=31, record=Path("first"))
    assert registering._continue_command(simulated, None, None, None, Path("first")) == (
        "markerseek register --simulate --seed 31 --continue first"
    )


@pytest.mark.parametrize("wait_s", [-1.0, 0.0, float("nan"), 1e9])
def test_a_wait_that_is_none_is_refused(wait_s: float) -> None:
    with pytest.raises(ConfigError, match=r"--wait-s is .* s, it must lie in \[1, 3600\] s"):
        SessionOptions(simulate=True, wait_s=wait_s)


def test_a_fault_names_the_command_that_goes_on(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    class Broken:
        def steps(self) -> Iterator[registration.Step]:
            yield registration.Ended(registered=False, said="over", rig_s=0.0)
            raise DeviceError("the line 'stage' is gone")

    with pytest.raises(DeviceError):
        registering._watch(Broken(), None, tmp_path, again="markerseek register --continue kept", as_json=False)  # type: ignore[arg-type]
    said = " ".join(capsys.readouterr().err.split())
    assert "once the fault is repaired, continue with: markerseek register --continue kept" in said
