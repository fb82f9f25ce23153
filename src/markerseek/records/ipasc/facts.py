"""What a bank in IPASC HDF5 says beside its measurements, in each version of the fields."""

from __future__ import annotations

import math

from markerseek.records.banks import BankFacts
from markerseek.records.careful.hdf5 import CarefulFile
from markerseek.records.ipasc import fields

_LONGEST_SEED = 100


def read_facts(file: CarefulFile, *, version: int | None, pitch_m: float | None) -> BankFacts:
    """What is known of a bank; somebody else's, without a version, counts its times from 1970.

    Raises
    ------
    ValueError
        If a field does not hold what it should.
    """
    return BankFacts(
        description=file.text(fields.DESCRIPTION) or "",
        probe=file.text(fields.PROBE),
        sampling_hz=_between(file, fields.SAMPLING, 1e5, 1e9),
        sound_speed_m_s=_between(file, fields.SOUND_SPEED, 300.0, 7000.0),
        pitch_m=pitch_m,
        wavelength_m=_first(file, fields.WAVELENGTH),
        pulse_energy_j=_first(file, fields.PULSE_ENERGY),
        face_radius_m=_between(file, fields.FACE_RADIUS, 0.0, 1.0),
        reference_angle_deg=file.number(fields.REFERENCE),
        clock_zero_unix_s=_clock_zero_unix_s(file, version),
        simulated=_truth(file.number(fields.SIMULATED)),
        configuration=file.text(fields.CONFIGURATION),
        seed=_seed(file.text(fields.SEED)),
        made_with=file.text(fields.MADE_WITH),
    )


def _clock_zero_unix_s(file: CarefulFile, version: int | None) -> float | None:
    if version is None:
        return 0.0 if file.has(fields.TIMES) and file.text(fields.TIMES) is None else None
    return file.number(fields.CLOCK_ZERO)


def _truth(number: float | None) -> bool | None:
    return None if number is None else number != 0


def _seed(text: str | None) -> int | None:
    return int(text) if text is not None and text.isdecimal() and len(text) <= _LONGEST_SEED else None


def _between(file: CarefulFile, name: str, low: float, high: float) -> float | None:
    """A number in SI units that must lie in a range, by which a damaged one is known; None where it is missing."""
    value = file.number(name)
    if value is not None and not low <= value <= high:
        raise ValueError(f"{name} is {value:g}, it must lie between {low:g} and {high:g}")
    return value


def _first(file: CarefulFile, name: str) -> float | None:
    """The first of the numbers; None where there is none, or pacfish wrote that there is none."""
    if not file.has(name) or file.text(name) == "None":
        return None
    values = file.numbers(name)
    return float(values[0]) if values.size and math.isfinite(values[0]) else None
