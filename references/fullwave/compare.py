# ruff: noqa: INP001 -- programs in a folder, no package
"""markerseek's forward model beside the stored full-wave output: envelope peaks, as absolute pressures.

    python references/fullwave/compare.py

Needs markerseek and NumPy only. Nothing is fitted: the pressures of both sides are per unit of initial pressure in the
middle of the absorber, and the arrival times count from the light.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markerseek.acoustics import (
    Absorber,
    AcousticModel,
    Band,
    GaussianAbsorber,
    GaussianPulse,
    LaserPulse,
    Medium,
    Probe,
    RectanglePulse,
)
from markerseek.acoustics.pulse import REFERENCE_RANGE_M
from markerseek.core import LinearArray

HERE = Path(__file__).parent
SAMPLING_HZ = 40e6  # of markerseek's own output
FINE_HZ = 1.6e9  # at which envelopes are looked at
AT_ONCE = GaussianPulse(fwhm_s=0.1e-9)  # light that comes at once: flat over the band to 1e-5
LINE_HALF_M, LINE_STEP_M = 24e-3, 0.05e-3  # line of points that stands for the invisible axis of the 2-D run
HEADS = (
    "angle",
    "full wave: peak / peak at 0°",
    "ours / full wave − 1",
    "difference / peak at 0°",
    "our peak is later by",
    "pulses differ by at most",
)
VOLUME_BAND = Band(centre_hz=4e6, low_hz=3e6, high_hz=5e6)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stored:
    """What one full-wave run left: traces over (angles, samples), with lens and without, and how they were made."""

    traces: Mapping[bool, np.ndarray]
    made: Mapping[str, object]

    def number(self, name: str) -> float:
        """Return the number that the run was made with."""
        return float(self.made[name])  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True, kw_only=True)
class Peaks:
    """Envelope peaks of both sides over the angles, in units of the initial pressure, and when they come."""

    angles_deg: np.ndarray
    full_wave: np.ndarray
    ours: np.ndarray
    full_wave_s: np.ndarray
    ours_s: np.ndarray
    waveform: np.ndarray
    """Largest difference of the two pulses anywhere, over the largest full-wave value at that angle."""

    @property
    def of_own(self) -> np.ndarray:
        """Ours less the full-wave peak, over the full-wave peak at the same angle."""
        return self.ours / self.full_wave - 1

    @property
    def of_first(self) -> np.ndarray:
        """Ours less the full-wave peak, over the full-wave peak at 0 degrees."""
        return (self.ours - self.full_wave) / self.full_wave[0]


def read(path: Path) -> Stored:
    """Return the stored output of ``make.py``."""
    with np.load(path) as file:
        return Stored(
            traces={True: file["with_lens"].astype(float), False: file["without_lens"].astype(float)},
            made=json.loads(str(file["provenance"])),
        )


def analytic(traces: np.ndarray, *, sampling_hz: float, first_s: float, band: Band | None, laser: LaserPulse | None,
             span_s: tuple[float, float]) -> np.ndarray:  # fmt: skip
    """Analytic signal on the fine grid over a span of time, after band and laser where they are given.

    The pressure that stands at the end of a record is faded out over 0.5 µs, so that it makes no step.
    """
    fade = np.ones(traces.shape[-1])
    count = int(0.5e-6 * sampling_hz)
    fade[-count:] = np.cos(np.linspace(0, np.pi / 2, count)) ** 2
    padded = 4096 * 2
    frequency_hz = np.fft.rfftfreq(padded, 1 / sampling_hz)
    spectrum = np.fft.rfft(traces * fade, padded)
    if band is not None:
        spectrum = spectrum * band.gain(frequency_hz)
    if laser is not None:
        spectrum = spectrum * laser.spectrum(frequency_hz)
    finer = round(FINE_HZ / sampling_hz)
    signal = np.fft.ifft(2 * spectrum, padded * finer) * finer
    low, high = (round((moment - first_s) * FINE_HZ) for moment in span_s)
    return signal[..., np.arange(low, high) % (padded * finer)]


def unit_pa(source: GaussianAbsorber, *, band: Band, laser: LaserPulse, sound_speed_m_s: float) -> float:
    """Pressure that markerseek calls 1, per unit of initial pressure: the envelope peak at the reference range.

    From the far-field pulse q(s)/r, q = −(s/2) exp(−s²/a²), sampled over time: the closed form of its spectrum in
    markerseek has no part in this.
    """
    time_s = (np.arange(4096) - 2048) / 400e6
    s = sound_speed_m_s * time_s
    pulse = -s / 2 * np.exp(-((s / source.radius_m) ** 2))
    frequency_hz = np.fft.rfftfreq(4096, 1 / 400e6)
    spectrum = np.fft.rfft(pulse) * band.gain(frequency_hz) * laser.spectrum(frequency_hz)
    return float(np.abs(np.fft.ifft(2 * spectrum, 4096 * 8) * 8).max()) / REFERENCE_RANGE_M


def heard(stored: Stored, *, band: Band, laser: LaserPulse, lens: bool, line: bool) -> np.ndarray:
    """Return what markerseek hears at the run's angles, per unit of initial pressure, shape (angles, samples).

    A run in a plane is a world in which nothing changes along the array: its absorber is a line, and a line of
    Gaussian balls of radius a with one each a·√π is one that is 1 in its middle. So the plane's trace is the sum of
    markerseek's own traces for points along the array, ∫ … dy/(a√π); its ends fade out over the outer half, since
    what comes from there is late and only the abrupt end would sound.
    """
    plane_width_m = 1e-6  # a point: the line is the same everywhere along the array
    probe = Probe(
        array=LinearArray(elements=3),
        element_width_m=plane_width_m if line else stored.number("width_m"),
        element_height_m=stored.number("height_m"),
        elevation_focus_m=stored.number("focus_m") if lens else None,
        face_radius_m=stored.number("face_radius_m"),
    )
    speed = stored.number("sound_speed_m_s")
    medium = Medium(sound_speed_m_s=speed, attenuation_db_cm_mhz=0.0)
    model = AcousticModel(probe=probe, medium=medium, laser=laser, band=band, sampling_hz=SAMPLING_HZ, samples=2600)
    source = GaussianAbsorber(radius_m=stored.number("source_radius_m"))
    lateral_m, strength = np.zeros(1), np.ones(1)
    if line:
        lateral_m = np.arange(-LINE_HALF_M, LINE_HALF_M + LINE_STEP_M / 2, LINE_STEP_M)
        fade = np.cos(np.pi / 2 * np.clip(2 * np.abs(lateral_m) / LINE_HALF_M - 1, 0, 1)) ** 2
        strength = fade * LINE_STEP_M / (source.radius_m * np.sqrt(np.pi))
    absorbers = [
        Absorber(radius_m=stored.number("radius_m"), lateral_m=y, strength=s, source=source)
        for y, s in zip(lateral_m.tolist(), strength.tolist(), strict=True)
    ]
    traces = [model.channel_data(absorbers, angle_deg=float(t))[1] for t in stored.made["angles_deg"]]  # type: ignore[attr-defined]
    return np.array(traces, dtype=float) * unit_pa(source, band=band, laser=laser, sound_speed_m_s=speed)


def compare(stored: Stored, *, band: Band, laser: LaserPulse = AT_ONCE, lens: bool = True) -> Peaks:
    """Envelope peaks of both sides at every angle of the run.

    Parameters
    ----------
    stored
        Full-wave output.
    band, laser
        Receive band and light, put on both sides.
    lens
        With or without the lens.
    """
    first_s = stored.number("first_sample") * stored.number("sample_s")
    traces = stored.traces[lens]
    span_s = (first_s, first_s + traces.shape[1] * stored.number("sample_s"))
    full = analytic(
        traces, sampling_hz=1 / stored.number("sample_s"), first_s=first_s, band=band, laser=laser, span_s=span_s
    )
    line = stored.number("width_m") == 0
    ours = heard(stored, band=band, laser=laser, lens=lens, line=line)
    mine = analytic(ours, sampling_hz=SAMPLING_HZ, first_s=0.0, band=None, laser=None, span_s=span_s)
    loud = np.abs(full).max(axis=1)
    return Peaks(
        angles_deg=np.array(stored.made["angles_deg"]),
        full_wave=loud,
        ours=np.abs(mine).max(axis=1),
        full_wave_s=span_s[0] + np.abs(full).argmax(axis=1) / FINE_HZ,
        ours_s=span_s[0] + np.abs(mine).argmax(axis=1) / FINE_HZ,
        waveform=np.abs(full - mine).max(axis=1) / loud,
    )


def table(title: str, peaks: Peaks) -> str:
    """Comparison as a Markdown table."""
    lines = [
        f"{title}\n",
        f"| {' | '.join(HEADS)} |",
        "|---|---|---|---|---|---|",
    ]
    for i, angle in enumerate(peaks.angles_deg):
        late_ns = (peaks.ours_s[i] - peaks.full_wave_s[i]) * 1e9
        lines.append(
            f"| {angle:.0f}° | {peaks.full_wave[i] / peaks.full_wave[0]:.4f} | {peaks.of_own[i]:+.2%} "
            f"| {peaks.of_first[i]:+.3%} | {late_ns:+.1f} ns | {peaks.waveform[i]:.2%} |"
        )
    return "\n".join(lines) + "\n\n"


def main() -> None:
    """Print the tables of the stored output, or of the files named on the command line."""
    for path in [Path(name) for name in sys.argv[1:]] or [HERE / "plane.npz", HERE / "volume.npz"]:
        stored = read(path)
        flat = stored.number("width_m") == 0
        band = Band() if flat else VOLUME_BAND
        sys.stdout.write(f"{path.name}: {stored.made['command']}, {stored.made['program']}\n\n")
        sys.stdout.write(table("With the lens", compare(stored, band=band)))
        sys.stdout.write(table("Without a lens", compare(stored, band=band, lens=False)))
        if flat:
            sys.stdout.write(
                table("With the lens, 500 ns of light", compare(stored, band=band, laser=RectanglePulse()))
            )


if __name__ == "__main__":
    main()
