"""Permit to fire, for one acquisition."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Permit:
    """Permits a number of pulses at one angle, until a moment, once.

    Attributes
    ----------
    token
        Name of the permit; used once.
    angle_deg
        Angle at which it holds, in degrees.
    pulses
        Most pulses that may be fired; 0 takes a dark frame.
    expires_s
        Moment on the rig's clock after which it is void, in seconds.
    """

    token: str
    angle_deg: float
    pulses: int
    expires_s: float
