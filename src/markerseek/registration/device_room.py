"""An operating room with a rig of devices and a stereo endoscope."""

from __future__ import annotations

from dataclasses import dataclass, field

from markerseek.core import StereoImages
from markerseek.registration.steps import Waiting
from markerseek.registration.stereo_files import StereoSettings
from markerseek.rigs import Rig

BETWEEN_S = 1.0
"""Time between two looks for a spot, in seconds: the laser fires in each."""


@dataclass(slots=True, kw_only=True)
class DeviceRoom:
    """A `Room` of devices: a person lights the spots, and the laser fires once a second until the cameras see one."""

    rig: Rig
    """The rig, armed by a person."""
    images: StereoImages
    stereo: StereoSettings
    by: str
    """Who has armed the rig for the session: each search disarms it at its end."""
    wait_s: float = 300.0
    """Longest wait for a spot, in seconds; then the session ends."""
    _waiting: tuple[str, float] = field(default=("", 0.0), init=False)

    def ask(self, waiting: Waiting) -> bool:
        """Look again in a moment, unless nobody has lit a spot for too long."""
        clock = self.rig.scanner.clock
        name, since_s = self._waiting
        if name != waiting.name:
            self._waiting = (waiting.name, clock.now_s())
        elif clock.now_s() - since_s > self.wait_s:
            return False
        else:
            clock.wait(BETWEEN_S)
        return True

    def arm(self) -> None:
        """Arm the rig in the name of the person who armed it for the session."""
        self.rig.arm(by=self.by)
