"""The laser goes dark when the search dies or hangs: real processes and signals, the truth comes from the emulated box.

How soon is measured by hand, on a quiet machine: `python -m tests.faults.laser_off --kills 100`. As a test it must only
be far sooner than the pulses would end; a search that hangs is in `test_signals`.
"""

from __future__ import annotations

import signal

import pytest

from tests.faults import laser_off

pytestmark = pytest.mark.real_time
pytest.importorskip("serial", reason="needs the extra devices")


def test_the_real_command_s_laser_is_disarmed_soon_after_a_kill() -> None:
    pytest.importorskip("serial", reason="needs the extra devices")
    (blow,) = laser_off.measure(kills=1, seed=1, how=signal.SIGKILL, busy=0, lease_s=1.0)
    assert blow.after_s < 1.0
    assert blow.threads > 1
