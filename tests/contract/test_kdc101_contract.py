"""The stage's driver on the emulated stage keeps the contract of a stage."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from markerseek.core import Stage
from markerseek.drivers import Kdc101Settings, Kdc101Stage
from markerseek.emulators import EmulatedKdc101
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.sim import VirtualClock
from markerseek.testing import StageContract
from tests.emulated_lines import DirectPort


@pytest.mark.parametrize("approach_from", ["below", "above"])
@pytest.mark.parametrize(
    "stands", [EmulatedKdc101(), EmulatedKdc101(zero_deg=123.4), EmulatedKdc101(zero_deg=-10.0, turns=1)], ids=str
)
class TestKdc101Stage(StageContract):
    @pytest.fixture(autouse=True)
    def _choose(self, stands: EmulatedKdc101, approach_from: str) -> None:
        self.stands = stands
        self.settings = Kdc101Settings(port="", zero_deg=stands.zero_deg, approach_from=approach_from)  # type: ignore[arg-type]

    def make(self) -> Stage:
        clock = VirtualClock()
        emulator = Kdc101Emulator(probe=SimpleNamespace(angle_deg=3.0), settings=self.stands)
        return Kdc101Stage(port=DirectPort(device=emulator, clock=clock), clock=clock, settings=self.settings)
