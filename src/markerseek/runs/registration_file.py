"""A registration that was made before, as ``markerseek register --json`` prints it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from markerseek.core import ConfigError, RecordError
from markerseek.files import MIB, read_input
from markerseek.geometry import RigidTransform
from markerseek.runs.registration import RegistrationReport


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownRegistration:
    """A registration to be shown to other programs."""

    name: str
    davinci_to_trus: RigidTransform
    """From the camera of the da Vinci system to the probe at 0 degrees, in metres."""
    simulated: bool
    """Whether markers and camera were simulated."""
    fre_m: float
    tre_m: float
    """``fre_m`` and ``tre_m``: fiducial registration error, and expected error at the target."""

    @property
    def known(self) -> dict[str, object]:
        """What is shown beside the transform."""
        return {"file": self.name, "simulated": self.simulated, "fre_m": self.fre_m, "tre_m": self.tre_m}


class _File(RegistrationReport, frozen=True, kw_only=True):
    """A report, and what a simulation adds to it."""

    simulation: Any = None


def read_registration(path: Path) -> KnownRegistration:
    """The registration in a file.

    ``path``: JSON of ``markerseek register --json``.
    """
    try:
        stored = msgspec.json.decode(read_input(path, most_bytes=8 * MIB), type=_File)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as problem:
        raise RecordError(
            f"{path}: it is no registration as JSON: {problem}; make one with 'markerseek register points.csv --json "
            "> registration.json'"
        ) from problem
    if not stored.registered or stored.davinci_to_trus is None:
        raise RecordError(f"{path}: its registration was not accepted ({stored.reason}); register again")
    rows = stored.davinci_to_trus
    if [len(row) for row in rows] != [4] * 4 or rows[3] != [0, 0, 0, 1]:
        raise RecordError(f"{path}: davinci_to_trus must have 4 rows of 4 numbers, the last row 0, 0, 0, 1")
    matrix = np.array(rows, dtype=float)
    try:
        transform = RigidTransform(
            source="DaVinci", target="ProbeHome", rotation=matrix[:3, :3], translation_m=matrix[:3, 3]
        )
    except ConfigError as problem:
        raise RecordError(f"{path}: {problem}") from problem
    return KnownRegistration(
        name=path.name,
        davinci_to_trus=transform,
        simulated=stored.simulation is not None,
        fre_m=stored.fre_m,
        tre_m=stored.tre_m,
    )
