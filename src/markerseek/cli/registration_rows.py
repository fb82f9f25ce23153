"""What people get to know of a registration, as names and values."""

from __future__ import annotations

from markerseek import registration


def report_rows(report: registration.RegistrationReport) -> list[tuple[str, str]]:
    """Return the rows that any registration has."""
    x, y, z = (1e3 * value for value in report.target_trus_m)
    assumed = " with 1 mm in each coordinate, because not all points have sigmas" if report.weights == "equal" else ""
    return [
        ("FRE", f"{1e3 * report.fre_m:.2f} mm, {1e3 * report.expected_fre_m:.2f} mm expected{assumed}"),
        ("expected TRE", f"{1e3 * report.tre_m:.2f} mm, in 95 % below {1e3 * report.tre95_m:.2f} mm"),
        ("at", f"x {x:.1f}, y {y:.1f}, z {z:.1f} mm of the TRUS frame"),
        *(
            (("spot and source", f"{1e3 * report.offset_m:.2f} mm apart in the middle"),)
            if report.offset_m is not None
            else ()
        ),
        *((each.name, each.said) for each in report.checks),
        *(("in doubt", doubt) for doubt in report.doubts),
        *((("assumed", report.assumed),) if report.assumed is not None else ()),
        *(
            (error.name, f"{error.value:+.2g} ± {error.sigma:.2g} {error.unit} too large according to the points")
            for error in report.shared
            if error.is_seen
        ),
        ("weights", report.weights),
        *((("without", ", ".join(report.without)),) if report.without else ()),
    ]


def session_rows(
    view: registration.SessionView, truth: registration.SimulatedTruth | None = None
) -> list[tuple[str, str]]:
    """Return the rows that only a session has; ``truth``: what a simulation knows that has just run."""
    counts = ", ".join(str(marker.acquisitions) for marker in view.markers)
    rows = [
        ("markers", f"{len(view.markers)}, with {counts} frames"),
        ("time of the rig", f"{view.rig_s:.0f} s, without waiting for spots"),
    ]
    if view.endoscope is not None:
        rows.append(("endoscope", view.endoscope.said))
    rows += [(f"marker {name}", said) for name, said in view.motions]
    if view.lost:
        rows.append(("lost", f"marker {', '.join(view.lost)}: it is not known where the endoscope sees it now"))
    if view.left_out:
        rows.insert(1, ("left out", f"marker {', '.join(view.left_out)}: it does not fit the others"))
    if truth is None:
        return rows
    low_min, high_min = (seconds / 60 for seconds in truth.by_hand_s)
    rows.append(("time by hand (the paper)", f"{low_min:g} to {high_min:g} min"))
    if truth.target_error_m is not None:
        rows.append(("true error at the target (simulated)", f"{1e3 * truth.target_error_m:.2f} mm"))
    return rows
