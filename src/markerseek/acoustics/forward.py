"""The forward model: channel data of absorbers at an angle of the probe, without noise.

Each channel is the mean of the pressure over one element's face (rigid baffle: no weight by direction),
taken by quadrature over its height, less the lens delay, and over its width. Sound travels in a straight line
through a uniform medium. Noise and converter are in `receiver`; imaging is in `signals`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated

import numpy as np
from scipy.special import roots_legendre

from markerseek.acoustics._kernel import add_absorbers, nodes_needed
from markerseek.acoustics.medium import Medium, Reverberation
from markerseek.acoustics.pulse import REFERENCE_RANGE_M, PulseTable, pulse_table
from markerseek.acoustics.receiver import Band, Probe
from markerseek.acoustics.source import Absorber, GaussianAbsorber, LaserPulse, RectanglePulse
from markerseek.core import ConfigError, Float32, Float64, Within, require_fields

_NEAREST_M = 1e-3
"""An absorber nearer in front of the face's plane than this, in metres, gives no signal, like one behind it."""


_rule = lru_cache(maxsize=512)(roots_legendre)


@lru_cache(maxsize=64)
def _rules(most: int) -> tuple[Float64[np.ndarray, "rules points"], Float64[np.ndarray, "rules points"]]:
    """Return the Gauss–Legendre nodes and weights of 1 to ``most`` points, one rule a row.

    The weights of a rule sum to 1.
    """
    nodes = np.zeros((most + 1, most))
    weights = np.zeros((most + 1, most))
    for points in range(1, most + 1):
        nodes[points, :points], weights[points, :points] = _rule(points)
    return nodes, weights / 2


@dataclass(frozen=True, slots=True, kw_only=True)
class AcousticModel:
    """Forward model of one probe.

    Unit of the data: an absorber of strength 1 at 50 mm (`REFERENCE_RANGE_M`) from a point of an element, in a lossless
    medium, gives that point a pulse whose envelope peaks at 1; the mean over a whole element is less. The table of a
    source is computed at its first call and cached, also for other models of the same laser, band, medium and sampling.
    """

    probe: Probe = field(default_factory=Probe)
    medium: Medium = field(default_factory=Medium)
    laser: LaserPulse = field(default_factory=RectanglePulse)
    band: Band = field(default_factory=Band)
    sampling_hz: Annotated[float, Within(0, 1e9, "Hz", open_low=True, cure="40 MHz is usual")] = 40e6
    samples: Annotated[int, Within(1, 1e6, cure="2080 is usual")] = 2080
    """Samples of one channel; sample 0 is the trigger."""
    trigger_offset_s: Annotated[float, Within(-1e-3, 1e-3, "s", cure="±1 µs are usual")] = 0.0
    """Time from the trigger to the middle of the laser pulse."""
    reverberation: Reverberation | None = None

    def __post_init__(self) -> None:
        require_fields(self, "acoustic model")

    def pulse(self, source: GaussianAbsorber) -> PulseTable:
        """Return the pulse of a source under this model's light, medium and band; computed once.

        ``source``: absorber's size and shape.
        """
        record_s = self.samples / self.sampling_hz + abs(self.trigger_offset_s)
        return pulse_table(
            source,
            laser=self.laser,
            band=self.band,
            medium=self.medium,
            sampling_hz=self.sampling_hz,
            longest_m=record_s * self.medium.sound_speed_m_s,
        )

    def channel_data(
        self, absorbers: Sequence[Absorber], *, angle_deg: float
    ) -> Float32[np.ndarray, "elements samples"]:
        """Return the channel data without noise, shape (elements, samples); see the class for the unit.

        An absorber that is, at this angle, behind the plane of the face or less than `_NEAREST_M` in front of it
        gives no signal: the probe's body hides it. Sound that arrives after the record is cut off.

        ``absorbers``: the sources; none gives zeros. ``angle_deg``: angle of the image plane about the axis of
        rotation.
        """
        if not math.isfinite(angle_deg):
            raise ConfigError(f"acoustic model: angle_deg is {angle_deg} deg, it must be a finite number")
        data = np.zeros((self.probe.array.elements, self.samples), dtype=np.float32)
        places: dict[GaussianAbsorber, list[tuple[float, float, float, float]]] = {}
        for absorber in absorbers:
            elevation, axial = self._place(absorber, angle_deg)
            if axial >= _NEAREST_M and absorber.strength != 0:
                places.setdefault(absorber.source, []).append(
                    # The kernel divides by the path; a strength is an amplitude at the reference range.
                    (absorber.lateral_m, elevation, axial, absorber.strength * REFERENCE_RANGE_M)
                )
        # Absorbers of one kind share a table of pulses and one call of the kernel.
        for source, rows in places.items():
            self._add(data, np.array(rows), self.pulse(source))
        return data

    def _place(self, absorber: Absorber, angle_deg: float) -> tuple[float, float]:
        """Return the elevation and axial distance of an absorber, in metres."""
        least = self.probe.face_radius_m + _NEAREST_M
        # Refused at every angle, also where the probe would hide it: at some angle it would be inside the probe.
        if not absorber.radius_m >= least:
            raise ConfigError(
                f"absorber: radius_m is {absorber.radius_m} m, which is inside the probe: "
                f"it must be at least {least:g} m (face radius and {_NEAREST_M:g} m)"
            )
        return self.probe.in_probe_frame(radius_m=absorber.radius_m, off_plane_deg=angle_deg - absorber.angle_deg)

    def _add(
        self,
        data: Float32[np.ndarray, "elements samples"],
        rows: Float64[np.ndarray, "absorbers 4"],
        pulse: PulseTable,
    ) -> None:
        """Add to the channels absorbers of one kind, each a row of lateral, elevation, axial place and strength."""
        probe = self.probe
        speed = self.medium.sound_speed_m_s
        half_height = probe.element_height_m / 2
        half_width = probe.element_width_m / 2
        wavenumber = 2 * math.pi * pulse.top_hz / speed
        # Along the face the path changes by at most 1 m per metre, and the lens adds at most 1 m per metre.
        half = max(half_height, half_width)
        nodes, weights = _rules(nodes_needed(2 * wavenumber * half, half / _NEAREST_M))
        repeats = 0
        gain = 0.0
        delay_s = 0.0
        if self.reverberation is not None:
            repeats = self.reverberation.repeats
            gain = self.reverberation.gain
            delay_s = self.reverberation.delay_s
        for repeat in range(repeats + 1):
            add_absorbers(
                data,
                rows[:, :3],
                rows[:, 3] * gain**repeat,
                probe.array.lateral_m,
                half_width,
                half_height,
                probe.elevation_focus_m or 0.0,
                nodes,
                weights,
                pulse.lines,
                pulse.loss_np_m,
                pulse.step_m,
                wavenumber,
                self.sampling_hz / speed,
                (self.trigger_offset_s + repeat * delay_s) * self.sampling_hz + pulse.first,
            )
