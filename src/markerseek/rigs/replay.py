"""A recorded scan as a rig."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np

from markerseek.core import ConfigError
from markerseek.guard import Admission, FiringLimits, Guard, Limits
from markerseek.records.banks import FrameBank, read_bank
from markerseek.records.replay import IntensityReader, ReplayLaser, ReplayReceiver, ReplayStage
from markerseek.rigs.rig import Rig, fingerprint
from markerseek.scan import Scanner
from markerseek.signals import PRESET_NAMES, ImageReader, probe_preset
from markerseek.sim import VirtualClock


def replayed(
    path: Path,
    *,
    probe: str = PRESET_NAMES[0],
    reference_deg: float | None = None,
    between: Literal["nearest", "interpolated"] = "nearest",
) -> Rig:
    """A rig that plays back a recorded scan; its search range is the range recorded.

    Parameters
    ----------
    path
        CSV of ``angle_deg,intensity``, or a folder with one sub-folder of SonixDAQ files per angle.
    probe
        Preset of the imaging chain, for channel data.
    reference_deg
        Angle of the marker that was found otherwise, in degrees, to be compared with.
    between
        What a search gets between two recorded angles: the nearest recorded one, or an intensity interpolated from both
        neighbours, as in the paper. Frames are never interpolated.

    Raises
    ------
    RecordError
        If the recording cannot be read.
    ConfigError
        If the preset is unknown, or the reference is no finite number.
    """
    if reference_deg is not None and not math.isfinite(reference_deg):
        raise ConfigError(f"reference_deg is {reference_deg} deg, it must be a finite number")
    preset = probe_preset(probe)
    bank = read_bank(path)
    stage = ReplayStage(bank, between=between)
    laser = ReplayLaser()
    receiver = ReplayReceiver(stage=stage, bank=bank)
    frames = isinstance(bank, FrameBank)
    imaging = ImageReader(preset) if frames else None
    interpolated = between == "interpolated" and not frames
    guard = Guard(
        limits=Limits(search=bank.range, travel=bank.range),
        # Nothing is fired, and time stands still.
        firing=FiringLimits(pulses_per_second=FiringLimits().pulses_per_session),
        # What was recorded cannot be taken again: saturation, dead channels and repeated data are borne.
        admission=Admission(saturated_limit=1.0, dead_limit=1.0, repeats=True),
        arrival_deg=1e-9 if interpolated else max(np.diff(bank.angles_deg)) / 2 * (1 + 1e-9),
    )
    scanner = Scanner(
        stage=stage,
        laser=laser,
        receiver=receiver,
        reader=imaging or IntensityReader(),
        clock=VirtualClock(),
        guard=guard,
        arms_itself=True,
    )
    return Rig(
        kind="replayed",
        description=f"{path}, {len(bank.angles_deg)} angles" + (", interpolated between them" if interpolated else ""),
        stage=stage,
        laser=laser,
        receiver=receiver,
        scanner=scanner,
        imaging=imaging,
        dark_frames=0,
        face_radius_m=None,
        truth_deg=None,
        configuration=fingerprint(bank),
        reference_deg=reference_deg,
        distinct_angles=None if interpolated else len(bank.angles_deg),
    )
