"""Small synthetic banks for tests, and ways to change the content of their files."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from markerseek.core import ChannelFrame, FrameHeader, Reading, Sample
from markerseek.records.banks import BankFacts, whole_bank

FIXTURES = Path(__file__).parents[3] / "data" / "banks"
FACTS = BankFacts(
    description="a simulated scan",
    probe="BPL9-5/55",
    sampling_hz=40e6,
    sound_speed_m_s=1540.0,
    pitch_m=0.43e-3,
    wavelength_m=760e-9,
    pulse_energy_j=2e-3,
    face_radius_m=10e-3,
    reference_angle_deg=1.25,
    clock_zero_unix_s=1.7e9,
    simulated=True,
    configuration="0123456789abcdef",
    seed=1 << 70,
    made_with="markerseek 0.0",
)


def counts(seed, shape=(8, 50)):
    return np.random.default_rng(seed).integers(-2048, 2048, shape).astype(np.int16)


def sample(angle_deg, *, seed=0, dark=False, shape=(8, 50), frame=True, energy=None):
    header = FrameHeader(
        sequence=seed + 1,
        token="a",
        pulses=0 if dark else 16,
        commanded_deg=angle_deg,
        started_s=seed * 2.0,
        ended_s=0,
        energy=energy,
    )
    channel = ChannelFrame(header=header, samples=counts(seed, shape), sampling_hz=40e6) if frame else None
    return Sample(angle_deg=angle_deg, reading=Reading(intensity=100.0 + seed), dark=dark, frame=channel)


ANGLES = (4.0, 2.0, 0.5, -1.0)


def write(path, *, taken=4, facts=FACTS, frame=True, energies=(None,) * 4):
    with whole_bank(path, facts=facts) as writer:
        for seed in (8, 9):
            writer.add(sample(0.0, seed=seed, dark=True, frame=frame))
        for seed, angle in enumerate(ANGLES[:taken]):
            writer.add(sample(angle, seed=seed, frame=frame, energy=energies[seed]))
    return path


def changed(path, change):
    """The same bank, changed by the library, which writes new checksums."""
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def put(name, value):
    def change(file):
        del file[name]
        file[name] = value

    return change
