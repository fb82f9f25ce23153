"""Tests the sense of rotation of a rig: a source at a known angle must be found there, not at the mirrored angle."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from markerseek import drivers, rigs, runs
from markerseek.cli.open_rig import arm_rig, open_rig
from markerseek.core import ConfigError, SearchPlan

MIN_DEG = 5.0
"""Smallest angle of a source at which its two sides can be distinguished, in degrees."""

_NEAR_DEG = 5.0
"""Largest accepted difference of the angle found, in degrees; at small angles half of the angle, if less."""

Verdict = Literal["right", "mirrored", "neither"]


def verdict_of(found_deg: float, source_deg: float) -> Verdict:
    """Whether a source was found at its true angle, at the mirrored angle, or elsewhere; both in degrees."""
    # With the full tolerance a source at 5 deg could be found at 0, which is neither side.
    near_deg = min(_NEAR_DEG, abs(source_deg) / 2)
    if abs(found_deg - source_deg) <= near_deg:
        return "right"
    return "mirrored" if abs(found_deg + source_deg) <= near_deg else "neither"


def steadiness(spread: float | None) -> str:
    """How steady the laser is, in words; ``spread`` is the relative standard deviation of an acquisition's energy."""
    if spread is None:
        return "too few samples show how steady the laser is"
    return f"the laser's energy differs by {spread:.1%} from one acquisition to the next"


def _usual_energy(rig: rigs.Rig) -> str:
    """What the rig's energy meter says of a usual pulse, for the rig file; empty if it has none."""
    meter = rig.receiver
    if not isinstance(meter, drivers.EnergyMeter) or meter.usual is None:
        return ""
    # Four digits, and no exponent.
    return f", and its meter says {float(f'{meter.usual:.4g}'):g} of a usual pulse (laser.usual_energy)"


def require_source_deg(source_deg: float) -> None:
    """Refuse an angle of a source, in degrees, that is too near to 0 to prove the sense; `ConfigError`."""
    if not MIN_DEG <= abs(source_deg) <= 360:
        raise ConfigError(
            f"--source-deg is {source_deg:g} deg, it must be at least {MIN_DEG:g} deg off 0 on either side"
        )


def prove_direction(path: Path, *, source_deg: float, arm: bool, as_json: bool) -> tuple[bool, str]:
    """Search a source at a known angle, and return whether the stage turns the right way, with what was found in words.

    ``source_deg``: true angle of the source on the probe's scale; see `require_source_deg`. ``arm``: whether the user
    armed the rig by an option; otherwise a question is asked on the terminal. ``as_json``: whether a program reads the
    output.
    """
    from markerseek.cli.session import run_new_session
    from markerseek.search.posterior import energy_spread

    with open_rig(path) as (rig, start_deg):
        search = rig.limits.search
        if source_deg not in search or -source_deg not in search:
            raise ConfigError(
                f"--source-deg is {source_deg:g} deg: it or the mirrored angle lies outside limits.search {search}; "
                "place the source nearer to 0"
            )
        session = runs.new_session(rig, runs.plan_on(rig, SearchPlan(method="posterior", start_deg=start_deg)))
        arm_rig(rig, file=path, arm=arm, what=f"search the source at {source_deg:g} deg", as_json=as_json)
        session = run_new_session(session, as_json=as_json, rig_file=path)
    result = session.result()
    if not result.found:
        return False, f"no source was found ({result.answer}: {result.reason}); place one point source, and no other"
    spread = energy_spread(session.view.samples, limits=search)
    usual = _usual_energy(rig)
    found = f"the source at {source_deg:g} deg was found at {result.angle_deg:.2f} deg; {steadiness(spread)}{usual}"
    match verdict_of(result.angle_deg, source_deg):
        case "right":
            return True, f"{found}: the stage turns the right way"
        case "mirrored":
            return False, f"{found}, the mirrored angle: the stage turns the other way round; change stage.direction"
        case "neither":
            return False, f"{found}: check --source-deg, zero_deg and stage.direction, and calibrate again"
