"""Assembles simulated rigs that return intensities instead of frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from markerseek.rigs.rig import Rig
from markerseek.rigs.simulated_devices import in_world, require_seed
from markerseek.signals import IntensityReader
from markerseek.sim import CurveWorld, IntensityCurve, SimulatedSettings, VirtualClock

USUAL_CELLS = 460_000
"""Approximate number of independent envelope cells in an image of the simulated probe."""


def of_intensities(
    *,
    seed: int,
    curve: IntensityCurve | None,
    marker_deg: float,
    cells: int = USUAL_CELLS,
    settings: SimulatedSettings | None = None,
    noise_stated: bool = True,
) -> Rig:
    """A simulated rig that returns intensities instead of frames, hundreds of times faster, for studies.

    Stage, laser, noise level and limits come from the settings; tissue and probe are contained in the curve.
    Intensities are in units of the noise's standard deviation. A reading has no lateral position or depth, and its
    noise level is exact.

    Parameters
    ----------
    seed
        Seed of noise and energy.
    curve
        Noise-free intensity over the angle off the marker; None: no source.
    marker_deg
        Angle of the marker in degrees.
    cells
        Independent envelope cells of an image.
    settings
        All other settings.
    noise_stated
        Whether dark frames can be taken, and each frame states noise and cells; false is as a CSV of intensities.

    Raises
    ------
    ConfigError
        If a setting cannot be used; bursts of noise need frames.
    """
    settings = settings or SimulatedSettings()
    rng = np.random.default_rng(require_seed(seed))
    world = CurveWorld.of_settings(
        settings, curve=curve, marker_deg=marker_deg, cells=cells, rng=rng, noise_stated=noise_stated
    )
    rig = in_world(
        world,
        settings,
        clock=VirtualClock(),
        reader=IntensityReader(),
        imaging=None,
        description=f"simulated intensities, peak SNR {settings.noise.peak_snr_db:g} dB, seed {seed}",
        seed=seed,
        truth_deg=marker_deg if settings.marker.present and curve is not None else None,
        rng=rng,
    )
    return rig if noise_stated else replace(rig, dark_frames=0)
