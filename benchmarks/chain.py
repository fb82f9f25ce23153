"""Our whole imaging chain on one simulated frame, and its parts."""

from __future__ import annotations

import numpy as np

from benchmarks.timing import Effort, Single, alone
from markerseek.acoustics import Absorber, AcousticModel, Noise, digitise
from markerseek.core import ChannelFrame, FrameHeader
from markerseek.signals import ImageReader, probe_preset
from markerseek.signals.beamform import beamform, image_grid
from markerseek.signals.filtering import band_pass, envelope

CHAIN = "chain: filter, beamform, envelope, features"


def measure(effort: Effort) -> tuple[list[Single], list[str]]:
    """Times of the chain at the default preset and at full aperture."""
    frame = _frame()
    preset = probe_preset("BPL9-5/55")
    reader = ImageReader(preset)
    picture = reader.picture(frame)
    reading = reader.read(frame)
    filtered = band_pass(frame.samples, preset)
    grid = image_grid(preset, samples=frame.samples.shape[1], depth_m=picture.depth_m)
    image = beamform(filtered, grid)
    singles = [
        alone(CHAIN, lambda: reader.read(frame), effort=effort),
        alone("  of it: filter", lambda: band_pass(frame.samples, preset), effort=effort),
        alone("  of it: beamform", lambda: beamform(filtered, grid), effort=effort),
        alone("  of it: envelope", lambda: envelope(image), effort=effort),
        alone("chain with all arrivals (`frame FILE`)", lambda: reader.findings(frame), effort=effort),
    ]
    rows, columns = picture.envelope.shape
    remark = (
        f"chain: preset {preset.name}, f-number {preset.f_number:g}, {columns} × {rows} pixels and the rows above and "
        f"below that the envelope needs; the source at lateral 3 mm, depth 32 mm was read at "
        f"{1e3 * (reading.lateral_m or 0):.2f} and {1e3 * (reading.depth_m or 0):.2f} mm"
    )
    return singles, [remark]


def _frame() -> ChannelFrame:
    """One source 32 mm from the face, with noise."""
    model = AcousticModel()
    absorber = Absorber(radius_m=model.probe.face_radius_m + 32e-3, lateral_m=3e-3, strength=300.0)
    heard = model.channel_data([absorber], angle_deg=0.0)
    noise = Noise(white_sigma=3.0, coloured_sigma=6.0)
    heard += noise.sample(
        np.random.default_rng(2), channels=heard.shape[0], samples=heard.shape[1], sampling_hz=model.sampling_hz
    )
    header = FrameHeader(sequence=1, token="bench", pulses=1, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
    return ChannelFrame(header=header, samples=digitise(heard), sampling_hz=model.sampling_hz)
