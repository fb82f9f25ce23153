"""Intensity curve of a scene over the angle, computed without noise by the acoustic model and the imaging chain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from markerseek.core import NO_HEADER, ChannelFrame, Float64, PaImage
from markerseek.rigs.scene import Scene
from markerseek.rigs.spot import MAX_COUNTS, image_reader
from markerseek.signals import ImageReader, strongest_peaks
from markerseek.sim import RecordedCurve

_OFF_PLANE_DEG = np.concatenate(
    [np.arange(0, 4, 0.2), np.arange(4, 12, 0.5), np.arange(12, 40, 1.0), np.arange(40, 80.1, 2.5)]
)
"""Angles off the marker at which a curve is computed, on one side: finer where it is steep."""

_PEAKS = 6
"""Number of separate peaks of an image that a curve stores."""

_APART_DEPTH_M, _APART_LATERAL_M = 0.3e-3, 0.5e-3
"""Peaks nearer than this, about a resolution cell, have the same noise and count as one."""


def scene_curve(scene: Scene) -> tuple[RecordedCurve, int]:
    """Intensity curve of a scene over the angle off its marker, and the number of independent cells of its images.

    Relative to the marker's peak with the probe on it, computed by the acoustic model and the imaging chain
    without noise: one frame for each angle of a fixed grid. A single absorber without clutter gives the same curve on
    both sides, which is computed on one.
    """
    reader, marker = image_reader(scene.model.probe.array, sampling_hz=scene.model.sampling_hz), scene.marker
    gain_to_counts = MAX_COUNTS / scene.peak_counts
    absorbers = [replace(absorber, strength=absorber.strength * gain_to_counts) for absorber in scene.absorbers]

    def frame_at(off_plane_deg: float) -> ChannelFrame:
        received = scene.model.channel_data(absorbers, angle_deg=marker.angle_deg + off_plane_deg)
        # Rounded like a real frame, at an amplitude at which rounding does not matter.
        counts = np.clip(np.rint(received), -32767, 32767).astype(np.int16)
        return ChannelFrame(header=NO_HEADER, samples=counts, sampling_hz=scene.model.sampling_hz)

    # One elevation for all sources makes the curve even in the angle, which halves the work.
    alike = all(absorber.angle_deg == marker.angle_deg for absorber in absorbers)
    angles = _OFF_PLANE_DEG if alike else np.concatenate([-_OFF_PLANE_DEG[:0:-1], _OFF_PLANE_DEG])
    heights = _heights(reader, frame_at, angles)
    if alike:
        angles = np.concatenate([-angles[:0:-1], angles])
        heights = np.concatenate([heights[:0:-1], heights])
    cells = reader.read(frame_at(0.0)).cells or 1
    return RecordedCurve(angles, heights / (scene.peak * gain_to_counts)), cells


def _heights(
    reader: ImageReader, frame_at: Callable[[float], ChannelFrame], angles_deg: Float64[np.ndarray, " angles"]
) -> Float64[np.ndarray, "angles peaks"]:
    """Heights of the separate peaks at each angle, strongest first, the strongest as the reader refines it."""
    heights = np.zeros((len(angles_deg), _PEAKS))
    for row, angle_deg in enumerate(angles_deg.tolist()):
        frame = frame_at(angle_deg)
        peaks = _separate(reader.picture(frame))
        if peaks:
            # The reader interpolates its peak between columns; the others are scaled by the same factor.
            heights[row, : len(peaks)] = np.array(peaks) * (reader.read(frame).intensity / peaks[0])
    return heights


def _separate(picture: PaImage) -> list[float]:
    """Local maxima of an image at least a resolution cell apart, strongest first."""
    largest = float(picture.envelope.max())
    kept: list[tuple[float, float, float]] = []
    if largest > 0:
        # 64 candidates, because one resolution cell has several local maxima.
        for row, column in strongest_peaks(picture.envelope, level=largest / 10, limit=64):
            depth_m, lateral_m = float(picture.depth_m[row]), float(picture.lateral_m[column])
            if all(
                abs(depth_m - depth) >= _APART_DEPTH_M or abs(lateral_m - lateral) >= _APART_LATERAL_M
                for depth, lateral, _ in kept
            ):
                kept.append((depth_m, lateral_m, float(picture.envelope[row, column])))
    return [height for _, _, height in kept[:_PEAKS]]
