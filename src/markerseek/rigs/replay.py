"""Assembles a rig that replays a recorded scan."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal, SupportsFloat

import msgspec
import numpy as np

from markerseek.core import ConfigError, RigFacts, require_range
from markerseek.guard import Admission, FiringLimits, Guard, Limits
from markerseek.records.banks import DEFAULT_FORMAT, FrameBank, IntensityBank, TableFormat
from markerseek.rigs.bank_probe import preset_of, read_recording
from markerseek.rigs.replay_devices import ReplayLaser, ReplayReceiver, ReplayStage
from markerseek.rigs.rig import Rig, fingerprint_of, with_probe
from markerseek.scan import Scanner
from markerseek.signals import ImageReader, IntensityReader, ProbePreset, is_own
from markerseek.sim import VirtualClock


class ReplayedRecipe(msgspec.Struct, frozen=True, kw_only=True, tag="replayed"):
    """Arguments of `markerseek.rigs.replayed`; the path is absolute."""

    path: str
    probe: str | ProbePreset | None
    reference_deg: float | None
    between: Literal["nearest", "interpolated"]
    table: TableFormat = DEFAULT_FORMAT


def replayed(
    path: Path | str,
    *,
    probe: str | ProbePreset | None = None,
    reference_deg: SupportsFloat | None = None,
    between: Literal["nearest", "interpolated"] = "nearest",
    table: TableFormat = DEFAULT_FORMAT,
) -> Rig:
    """Return a rig that plays back a recorded scan; its search range is the range recorded.

    Parameters
    ----------
    path
        A bank: IPASC HDF5, a folder of frames, or a CSV (`markerseek.records.banks.read_bank`).
    probe
        Preset of the imaging chain, for channel data, its name, or the name of a TOML file that describes a probe;
        None: the one that the bank names, else the first of all.
    reference_deg
        Reference angle of the marker in degrees, for comparison; None: the one in the bank.
    between
        Data between two recorded angles: those of the nearest, or an intensity interpolated from both neighbours, as in
        the paper. Frames are never interpolated.
    table
        Columns and unit of a CSV, as ``TableFormat(columns=("Winkel", "Peak"), unit="rad")`` of
        `markerseek.records.banks`.

    Raises
    ------
    RecordError
        If the recording cannot be read.
    ConfigError
        If the preset is unknown or of another number of channels, or the reference lies beyond one turn.
    """
    path = Path(path)
    reference_deg = None if reference_deg is None else float(reference_deg)
    if reference_deg is not None:
        require_range("reference_deg", reference_deg, low=-360, high=360, unit="deg")
    bank = read_recording(path, table, probe=probe)
    preset = preset_of(bank, probe)
    stage = ReplayStage(bank, between=between)
    laser = ReplayLaser()
    receiver = ReplayReceiver(stage=stage, bank=bank)
    frames = isinstance(bank, FrameBank)
    if reference_deg is None:
        reference_deg = bank.facts.reference_angle_deg
    if reference_deg is not None:
        # The angles of a scan that crosses 360 degrees were unwrapped.
        turns = (reference_deg, reference_deg - 360, reference_deg + 360)
        reference_deg = next((each for each in turns if each in bank.range), reference_deg)
    if isinstance(bank, FrameBank):
        _require_channels(path, bank, preset)
    imaging = ImageReader(preset) if frames else None
    interpolated = between == "interpolated" and not frames
    guard = Guard(
        limits=Limits(search=bank.range, travel=bank.range),
        # Time stands still, so all pulses fall into one second; nothing is fired.
        firing=FiringLimits(pulses_per_second=FiringLimits().pulses_per_session),
        # A recorded frame cannot be taken again, so saturation, dead channels and repeated data are accepted.
        admission=Admission(saturated_limit=1.0, dead_limit=1.0, noise_ratio=math.inf, repeats=True),
        # The stage goes to the nearest recorded angle, at most half the largest step away.
        arrival_deg=1e-9 if interpolated else max(np.diff(bank.angles_deg)) / 2 * (1 + 1e-9),
    )
    scanner = Scanner(
        stage=stage,
        laser=laser,
        receiver=receiver,
        reader=imaging or IntensityReader(),
        clock=VirtualClock(),
        guard=guard,
        # Nothing here emits light, so no person needs to arm it.
        arms_itself=True,
    )
    facts = RigFacts(
        kind="replayed",
        description=f"{path}, {len(bank.angles_deg)} angles" + (", interpolated between them" if interpolated else ""),
        fingerprint=_fingerprint(bank),
        search=bank.range,
        face_radius_m=bank.facts.face_radius_m,
        reference_deg=reference_deg,
    )
    return Rig(
        facts=with_probe(facts, imaging),
        stage=stage,
        laser=laser,
        receiver=receiver,
        scanner=scanner,
        imaging=imaging,
        dark_frames=bank.dark_frames,
        notes=bank.notes,
        angles_deg=None if interpolated else bank.angles_deg,
        recipe=ReplayedRecipe(
            path=str(path.absolute()),
            # A file of the user's own may change or disappear, so the probe itself is stored.
            probe=preset if is_own(preset) else preset.name,
            reference_deg=reference_deg,
            between=between,
            table=table,
        ),
    )


def _require_channels(path: Path, bank: FrameBank, preset: ProbePreset) -> None:
    """Refuse frames of another probe before anything is searched."""
    channels = bank.frame(0).samples.shape[0]
    if channels != preset.array.elements:
        raise ConfigError(
            f"{path}: its frames have {channels} channels, and the probe {preset.name} has {preset.array.elements}; "
            "name the probe that took them, `probe=NAME`, or describe it, `probe=FILE.toml`"
        )


def _fingerprint(bank: IntensityBank | FrameBank) -> str:
    """Return the fingerprint of a recording: of its metadata, without its frames.

    Unknown metadata are left out, so that it does not change when a later version adds a field.
    """
    facts = msgspec.to_builtins(bank.facts)
    known = {name: value for name, value in facts.items() if value is not None}
    return fingerprint_of({"angles_deg": bank.angles_deg, "intensities": bank.intensities, "facts": known})
