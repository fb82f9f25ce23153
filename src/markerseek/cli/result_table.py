"""The result of a search as people read it."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from markerseek.cli.terminal import people
from markerseek.records.result import SearchResult


def facts(result: SearchResult) -> list[tuple[str, str]]:
    """Names and values of a result, as people read them."""
    rows = [("answer", result.answer if result.reason is None else f"{result.answer}: {result.reason}")]
    if result.found and result.sigma_deg is not None and result.interval95_deg is not None:
        low, high = result.interval95_deg
        rows.append(("marker angle", f"{result.angle_deg:.3f}° ± {result.sigma_deg:.3f}°"))
        rows.append(("95 % interval", f"[{low:.3f}°, {high:.3f}°], {_KINDS[result.interval_kind or 'propagated']}"))
    else:
        rows.append(("the rule points at", f"{result.angle_deg:.3f}°, which is not claimed"))
    if result.marker_trus_m is not None:
        rows.append(("marker in the TRUS frame", "x {:.1f}, y {:.1f}, z {:.1f} mm".format(*_mm(result.marker_trus_m))))
    rows.append(("acquisitions", str(result.acquisitions) + (f", {result.refused} refused" if result.refused else "")))
    rows.append(("rotation", f"{result.travel_deg:.1f}°"))
    if result.elapsed_s is not None:
        rows.append(("time", f"{result.elapsed_s:.0f} s" + (" (virtual)" if result.rig == "simulated" else "")))
    if result.confirmation is not None:
        confirmation = result.confirmation
        verdict = "confirmed" if result.confirmed else "NOT confirmed: weaker than it should be"
        rows.append(
            ("confirmation", f"intensity {confirmation.intensity:.4g} at {confirmation.angle_deg:.3f}°, {verdict}")
        )
    if result.floor is not None:
        level = "unknown" if result.floor.level is None else f"{result.floor.level:.4g} from {result.floor.source}"
        rows.append(("noise floor", level))
    if result.truth_deg is not None and result.error_deg is not None:
        rows.append(("truth (simulated)", f"{result.truth_deg:.3f}°, error {result.error_deg:.3f}°"))
    elif result.reference_deg is not None and result.error_deg is not None:
        rows.append(("reference", f"{result.reference_deg:.3f}°, difference {result.error_deg:.3f}°"))
    return rows


_KINDS = {
    "posterior": "a posterior probability",
    "bracket": "the bracket's width, not a probability",
    "propagated": "noise propagated through the average, not a posterior",
}


def method_in_words(result: SearchResult) -> str:
    """Name of the method, and its form."""
    return result.method + (" as published" if result.as_published else "")


def _mm(point_m: tuple[float, float, float]) -> list[float]:
    return [1e3 * value for value in point_m]


def print_result(result: SearchResult, description: str) -> None:
    """Print a result on standard output, with the rig in words."""
    people.print(f"[bold]{escape(method_in_words(result))}[/] on a {result.rig} rig: {escape(description)}")
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for name, value in facts(result):
        table.add_row(f"[dim]{name}[/]", escape(value))
    people.print(table)
