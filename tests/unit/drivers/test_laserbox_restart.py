"""A laser box that restarts when its port is opened."""

from __future__ import annotations

import pytest

from markerseek.core import NotConnectedError
from markerseek.drivers import (
    LaserBox,
)
from tests.emulated_lines import DirectPort
from tests.unit.drivers.laserbox_bench import Bench as LaserBoxBench
from tests.unit.drivers.laserbox_bench import permit as laser_permit


@pytest.mark.parametrize("boot_s", [0.7, 1.0, 2.0])
@pytest.mark.parametrize("keeps", [False, True])
def test_a_box_that_restarts_when_its_port_is_opened_is_greeted_again(boot_s: float, keeps: bool) -> None:
    """One that keeps what came while it was deaf answers each HELLO, and none of these answers is taken for another."""
    box = LaserBoxBench()
    box.faults.inject("restart", 0.0 if keeps else boot_s)
    kept = bytearray()

    class Keeping:
        def advance(self, now_s: float) -> bytes:
            said = box.box.advance(now_s)
            if kept and now_s >= boot_s:
                said += box.box.feed(bytes(kept))
                kept.clear()
            return said

        def feed(self, data: bytes) -> bytes:
            if box.clock.now_s() < boot_s:
                kept.extend(data)
                return b"boot\r\n"
            return box.box.feed(data)

    port = DirectPort(device=Keeping() if keeps else box.box, clock=box.clock)
    laser = LaserBox(port=port, clock=box.clock)
    assert box.clock.now_s() < boot_s + 1
    for token in ("a", "b"):
        box.clock.wait(1.0)
        assert laser.fire(laser_permit(token)) == 16
    assert len(box.box.pulses) == 32


def test_a_box_that_stays_deaf_is_given_up_in_time() -> None:
    box = LaserBoxBench()
    box.faults.inject("restart", 60.0)
    with pytest.raises(NotConnectedError, match=r"no answer to HELLO in time: .*bytes came .*\('MicroPython v1\.2"):
        box.driver()
    assert 2.5 < box.clock.now_s() < 4
