"""Rig files of emulated devices: the part that follows from the simulated world behind them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from markerseek.sim import SimulatedSettings


def world_text(settings: SimulatedSettings) -> str:
    """Probe and limits of a simulated world as the end of a rig file (TOML)."""
    limits = settings.limits
    return f"""[probe]
trigger_offset_s = {settings.receiver.trigger_offset_s}
face_radius_m = {settings.probe.face_radius_m}

[limits.search]
low_deg = {limits.search.low_deg}
high_deg = {limits.search.high_deg}

[limits.travel]
low_deg = {limits.travel.low_deg}
high_deg = {limits.travel.high_deg}
"""


def write_rig_file(path: Path, text: str) -> None:
    """Write a rig file whole, or not at all."""
    from markerseek.files import replace_file

    with replace_file(path) as part:
        part.write_text(text, encoding="utf-8")
