"""What a session says to people: how it stands, what they are to do, what the endoscope did."""

from __future__ import annotations

from collections.abc import Sequence

from markerseek.registration.choice import Choice
from markerseek.registration.endoscope_motion import SeenEndoscope
from markerseek.registration.poses import Place
from markerseek.registration.stations import CarriedMarkers, stands_elsewhere
from markerseek.registration.steps import TakenMarker

GO_ON = "go on with the ventilation"
"""What is said once a marker is taken for which the ventilation was held."""


def state_in_words(choice: Choice, place: Place | None, *, goal_m: float) -> str:
    """Return the state of a session in a sentence; ``goal_m``: expected error at which it ends."""
    report = choice.report
    left = f"; left out, because it does not fit: marker {', '.join(choice.left_out)}" if choice.left_out else ""
    if report is None or not report.registered:
        return f"not registered: {choice.reason}{left}"
    if not choice.decided:
        return f"not certain: {choice.reason}; {report.expected}"
    left += "".join(f"; {doubt}" for doubt in report.doubts)
    if report.tre_m <= goal_m:
        return f"registered: {report.expected}{left}"
    more = "" if place is None or place.tre_m is None else f"; another marker lowers it to {1e3 * place.tre_m:.2f} mm"
    return f"registered above the goal of {1e3 * goal_m:g} mm: {report.expected}{more}{left}"


def asking_for(place: Place | None) -> str:
    """Return what the person has to do now, in a sentence."""
    if place is None:
        return "light a spot that the probe can reach and both cameras see"
    x_px, y_px = place.left_px
    return f"light the next spot near ({x_px:.0f}, {y_px:.0f}) px of the left image"


def with_hold(said: str, markers: Sequence[TakenMarker]) -> str:
    """Return what the person has to do, with what to ask of the anaesthetist; ``markers``: those taken so far."""
    before = f"{GO_ON}; " if markers else ""
    took = f", for about {max(marker.rig_s for marker in markers):.0f} s" if markers else ""
    return (
        f"{before}{said}; then hold the ventilation at the end of exhalation until its marker is taken{took}, and "
        "say so once it is held"
    )


def endoscope_in_words(markers: Sequence[TakenMarker], carried: CarriedMarkers, now: SeenEndoscope | None) -> list[str]:
    """Say whether the endoscope has moved, or may have, and which markers do not count."""
    seen = markers[-1].endoscope if markers else None
    said = [seen.said] if seen is not None and stands_elsewhere(markers[:-1], seen) else []
    said += [now.said] if now is not None else []
    if carried.lost:
        names = f"marker {', '.join(carried.lost)}"
        said.append(
            f"the endoscope may see {names} elsewhere now, so that it does not count: light new spots, or say that the "
            "endoscope is held"
        )
    return said


def target_in_words(target_trus_m: tuple[float, float, float] | None) -> str:
    """Return a target in words."""
    if target_trus_m is None:
        return "the usual one"
    return " ".join(f"{1e3 * each:g}" for each in target_trus_m) + " mm"
