"""A bank as the CSV that `read_bank` reads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from markerseek.files import new_file
from markerseek.records.banks import IntensityBank
from markerseek.records.banks.table import write_bank


def write_intensities(path: Path, *, angles_deg: Sequence[float], intensities: Sequence[float]) -> None:
    """Write intensities over angles in degrees as a new CSV; `RecordError` if it cannot be written."""
    with new_file(path) as part:
        write_bank(IntensityBank(angles_deg=tuple(angles_deg), intensities=tuple(intensities)), part)
