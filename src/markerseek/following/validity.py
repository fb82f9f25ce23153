"""Whether the devices are still those of a registration, as far as it can be seen.

A stage that was switched off and on must be homed, and stands elsewhere then than where it was left. That a camera was
off cannot be seen: a person says that it was not.
"""

from __future__ import annotations

from pathlib import Path

import msgspec

from markerseek.files import replace_file
from markerseek.registration import Begun

CONFIRMED = "confirmed.json"
"""Name of the file in the folder of a session with the devices by which a spot has confirmed its registration last."""


class DevicesSeen(msgspec.Struct, frozen=True, kw_only=True):
    """Devices, as far as another time can be compared with them."""

    rig: str
    """Fingerprint of the rig."""
    description: str
    """The rig in words."""
    cameras: str | None
    """Calibration of the cameras, as text; None: no cameras are named."""
    stage_since: str
    """Since when the stage has always stood where it was left, UTC; empty: nobody kept it."""

    @classmethod
    def of_session(cls, begun: Begun) -> DevicesSeen:
        """Return those of a registration session."""
        return cls(rig=begun.rig, description=begun.description, cameras=begun.cameras, stage_since=begun.stage_since)

    def changes_since(self, then: DevicesSeen) -> tuple[str, ...]:
        """Return what differs from devices of an earlier time, in sentences; empty if nothing is seen."""
        said = []
        if self.description != then.description:
            said.append(f"the rig is {self.description}, it was {then.description}")
        elif self.rig != then.rig:
            said.append("the rig file is another one: its probe, its limits or keys of its devices have changed")
        if None not in (self.cameras, then.cameras) and self.cameras != then.cameras:
            said.append("the calibration of the cameras is another one")
        if then.stage_since and self.stage_since != then.stage_since:
            said.append(
                f"the stage did not stand where it was left at {self.stage_since or 'an unknown time'}: it was "
                "switched off and on, homed, or turned by another program"
            )
        return tuple(said)


def read_confirmed(session: Path) -> DevicesSeen | None:
    """Return the devices by which a spot has confirmed the registration of a session last; None: none has."""
    try:
        return msgspec.json.decode((session / CONFIRMED).read_bytes(), type=DevicesSeen)
    except (OSError, msgspec.MsgspecError):
        return None


def write_confirmed(session: Path, devices: DevicesSeen) -> None:
    """Note the devices by which a spot has confirmed the registration of a session; `OSError` if it cannot be."""
    with replace_file(session / CONFIRMED) as part:
        part.write_bytes(msgspec.json.encode(devices))
