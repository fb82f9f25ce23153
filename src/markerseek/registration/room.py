"""Where a registration session takes place."""

from __future__ import annotations

from typing import Protocol

from markerseek.core import StereoImages
from markerseek.registration.steps import Waiting
from markerseek.registration.stereo_files import StereoSettings
from markerseek.rigs import Rig


class Room(Protocol):
    """Where a session takes place: a rig, the images of its endoscope, and somebody who moves the spot."""

    @property
    def rig(self) -> Rig:
        """The rig, armed."""

    @property
    def images(self) -> StereoImages:
        """Images of both cameras."""

    @property
    def stereo(self) -> StereoSettings:
        """Calibration of the cameras."""

    def ask(self, waiting: Waiting) -> bool:
        """Ask for a spot; whether to look for one now. False ends the session."""

    def arm(self) -> None:
        """Arm the rig in the name of the person who is there: each search disarms it at its end."""
