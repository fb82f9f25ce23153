"""One simulated frame by ours and by others, and what noise, converter and further absorbers cost."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.fft
import scipy.signal

from benchmarks.forward_peers import esdiva_element, pymust_simus
from benchmarks.timing import Effort, Pair, Single, Work, alone, in_turn
from markerseek.acoustics import Absorber, AcousticModel, Bursts, GaussianPulse, Medium, Noise, Probe, digitise

FORWARD = "simulate a frame, noise-free"
NOISE = "noise, bursts and 12 bits"
FURTHER = "each further absorber"
ANGLES_DEG = (0.0, 10.0, 35.0)

_RADIUS_M = 50e-3
_LATERAL_M = 4e-3


def compare(effort: Effort) -> tuple[list[Pair], list[str]]:
    """Comparisons of the noise-free frame, 10° off the plane, and remarks."""
    plane = AcousticModel(
        probe=Probe(elevation_focus_m=None),
        medium=Medium(attenuation_db_cm_mhz=0.0),
        laser=GaussianPulse(fwhm_s=5e-9),
    )
    elevation, axial = plane.probe.in_probe_frame(radius_m=_RADIUS_M, off_plane_deg=10.0)
    place = (_LATERAL_M, elevation, axial)
    work = f"{FORWARD}, 10° off plane"
    makers: tuple[tuple[str, AcousticModel, Callable[..., Work], Callable[..., str]], ...] = (
        ("esdiva, one element at 128 points", plane, esdiva_element, _waveforms),
        ("PyMUST simus (two-way only)", AcousticModel(), pymust_simus, _other_quantity),
    )
    pairs: list[Pair] = []
    remarks: list[str] = []
    for name, model, make, judge in makers:
        ours = partial(model.channel_data, [_absorber()], angle_deg=10.0)
        try:
            theirs = make(model, source_m=place)
            agreement = judge(ours(), theirs())
        except (ImportError, OSError) as error:
            remarks.append(f"{work}: {name} could not be run here ({error})")
            continue
        pairs.append(in_turn(work, ours, name, theirs, agreement=agreement, effort=effort))
    remarks.append(
        "simulation: beside esdiva, both without lens and loss and with one pulse; beside PyMUST, both with a lens"
    )
    return pairs, remarks


def measure(effort: Effort) -> tuple[list[Single], list[str]]:
    """Times of ours alone: the frame at several angles, further absorbers, noise and converter."""
    model = AcousticModel()
    singles = [
        alone(
            f"{FORWARD}, {angle:g}°, default probe and tissue",
            partial(model.channel_data, [_absorber()], angle_deg=angle),
            effort=effort,
        )
        for angle in ANGLES_DEG
    ]
    crowd = [_absorber(lateral_m=x, angle_deg=7 * math.sin(1e3 * x)) for x in np.linspace(-20e-3, 20e-3, 21)]
    many = alone("21 absorbers", partial(model.channel_data, crowd, angle_deg=10.0), effort=effort)
    share = 1 / (len(crowd) - 1)
    one = singles[1]
    further = Single(
        work=FURTHER,
        ms=(many.ms - one.ms) * share,
        least_ms=(many.least_ms - one.least_ms) * share,
        most_ms=(many.most_ms - one.most_ms) * share,
        processor_ms=(many.processor_ms - one.processor_ms) * share,
        rounds=many.rounds,
    )
    rng = np.random.default_rng(3)
    noise = Noise(white_sigma=3.0, coloured_sigma=6.0, bursts=Bursts(frame_probability=0.05, channel_probability=0.05))
    frame = model.channel_data([_absorber()], angle_deg=0.0)

    def listen() -> np.ndarray:
        drawn = noise.sample(rng, channels=frame.shape[0], samples=frame.shape[1], sampling_hz=model.sampling_hz)
        drawn += frame
        return digitise(drawn)

    return [*singles, further, alone(NOISE, listen, effort=effort)], []


def _absorber(*, lateral_m: float = _LATERAL_M, angle_deg: float = 0.0) -> Absorber:
    return Absorber(radius_m=_RADIUS_M, lateral_m=lateral_m, angle_deg=angle_deg, strength=300.0)


def _waveforms(ours: np.ndarray, theirs: np.ndarray) -> str:
    """Differences after one factor, and one delay below a sample (theirs begin between samples), for all channels."""
    phase = -2j * np.pi * scipy.fft.rfftfreq(theirs.shape[1])
    spectrum = scipy.fft.rfft(theirs, axis=1)
    nearest = theirs
    least = np.inf
    for delay in np.linspace(-1, 1, 41):
        late = scipy.fft.irfft(spectrum * np.exp(delay * phase), theirs.shape[1], axis=1)
        late *= np.vdot(ours, late) / np.vdot(late, late)
        difference = np.abs(ours - late).max() / np.abs(ours).max()
        if difference < least:
            nearest = late
            least = difference
    peaks = [np.abs(scipy.signal.hilbert(each, axis=1)).max(axis=1) for each in (ours, nearest)]
    return f"envelope peaks {np.abs(peaks[1] / peaks[0] - 1).max():.1%}, waveforms {least:.1%} of the peak"


def _other_quantity(ours: np.ndarray, theirs: np.ndarray) -> str:  # noqa: ARG001
    """What is said of outputs that are no frame of a source that sounds by itself."""
    return "not compared: sent and scattered back, so another quantity"
