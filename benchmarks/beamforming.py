"""One frame beamformed, 128 × 2080 samples to 128 × 1000 pixels, by ours and by others in turn."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from msgspec import structs

from benchmarks import beamforming_peers as peers
from benchmarks.c_limit import c_kernel, compiler
from benchmarks.timing import Effort, Pair, Work, in_turn
from markerseek.signals._kernel import PAD
from markerseek.signals.beamform import ImageGrid, beamform, image_grid
from markerseek.signals.presets import ProbePreset

SAMPLES = 2080
DEPTH_M = np.linspace(2e-3, 57e-3, 1000)
"""Deepest row: the far corner is still within the record, so that nobody leaves a pixel or an element out."""

FULL_APERTURE = "beamforming, full aperture"
F_NUMBER_1 = "beamforming, f-number 1"
C_LIMIT = "the same in C"


def compare(effort: Effort) -> tuple[list[Pair], list[str]]:
    """Comparisons at full aperture and at f-number 1, and remarks on what could not be run."""
    full = ProbePreset(name="bench", f_number=0.0)
    rng = np.random.default_rng(1)
    signals = np.zeros((SAMPLES, full.array.elements + 2 * PAD), np.float32)
    signals[:, PAD:-PAD] = rng.standard_normal((SAMPLES, full.array.elements))
    plain = np.ascontiguousarray(signals[:, PAD:-PAD])
    pairs: list[Pair] = []
    remarks: list[str] = []
    for work, preset in ((FULL_APERTURE, full), (F_NUMBER_1, structs.replace(full, f_number=1.0))):
        grid = image_grid(preset, samples=SAMPLES, depth_m=DEPTH_M)
        ours = partial(beamform, signals, grid)
        for name, make, normalised in _peers(signals, plain, preset, grid):
            try:
                theirs = make()
                agreement = _agreement(ours(), theirs(), preset, grid, normalised=normalised)
            except (ImportError, OSError) as error:
                remarks.append(f"{work}: {name} could not be run here ({error})")
                continue
            pairs.append(in_turn(work, ours, name, theirs, agreement=agreement, effort=effort))
    if compiler() is None:
        remarks.append("the limit in C could not be measured: gcc is not installed")
    return pairs, remarks


def _peers(
    signals: np.ndarray, plain: np.ndarray, preset: ProbePreset, grid: ImageGrid
) -> list[tuple[str, Callable[[], Work], bool]]:
    """Name and maker of each peer's work, and whether its sums are normalised as ours are."""

    def others(make: Callable[..., Work], **more: bool) -> Callable[[], Work]:
        return partial(make, plain, preset, lateral_m=grid.lateral_m, depth_m=grid.depth_m, **more)

    entries = [
        ("PyMUST dasmtx as it comes", others(peers.pymust_matrix, single=False), False),
        ("PyMUST dasmtx as float32 CSR", others(peers.pymust_matrix, single=True), False),
    ]
    if preset.f_number == 0:
        entries += [
            ("NumPy gather, delays per frame", others(peers.numpy_gather), False),
            ("fast-das (C++)", others(peers.fast_das), False),
            ("vbeam (JAX, compiled)", others(peers.vbeam_jax), False),
        ]
    if compiler() is not None:
        entries.append((C_LIMIT, partial(c_kernel, signals, grid), True))
    return entries


def _agreement(ours: np.ndarray, theirs: np.ndarray, preset: ProbePreset, grid: ImageGrid, *, normalised: bool) -> str:
    """Largest difference over the largest value; ours is first multiplied by the root of the number of channels."""
    if theirs.shape != ours.shape:
        raise ValueError(f"the peer's image has the shape {theirs.shape}, ours {ours.shape}")
    if not normalised:
        offset = np.abs(grid.lateral_m[:, None] - preset.array.lateral_m)
        half = np.full(len(grid.depth_m), np.inf) if preset.f_number == 0 else grid.depth_m / (2 * preset.f_number)
        used = (offset[None] <= half[:, None, None] * (1 + 1e-9)).sum(axis=2)
        ours = ours * np.sqrt(used)
    return f"{np.abs(ours - theirs).max() / np.abs(theirs).max():.0e} of the peak"
