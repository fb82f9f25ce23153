"""The report of a registration session that is kept, as a page of HTML and as PDF."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from rich.markup import escape

from markerseek import registration
from markerseek._version import __version__
from markerseek.bridges import page
from markerseek.cli.registration_rows import report_rows, session_rows
from markerseek.cli.report import Report, file_line
from markerseek.cli.terminal import local_time
from markerseek.core import ConfigError
from markerseek.registration import SessionView, SpotRefused, StereoSettings, TakenMarker

if TYPE_CHECKING:
    from markerseek.show import CameraView, Document, DocumentFigure, Rows


def write_report(folder: Path, out: Path | None) -> Report:
    """Write the report of a session into its folder, or into another one; returns what the command prints."""
    from markerseek.show import require_room_for_pictures, write_document_page, write_document_pdf

    place = out or folder
    known = registration.session_folder(folder)
    if known is None:
        raise ConfigError(f"{folder}: it is no folder of a session; `register --list` names those that are kept")
    require_room_for_pictures(place)
    steps = registration.read_session(known)
    view = registration.as_it_runs(registration.view_of(steps, known), known)
    refused = [step for step in steps if isinstance(step, SpotRefused)]
    checks = {step.name: step for step in steps if isinstance(step, TakenMarker) and step.check}
    document = _document(view, refused, checks, known)
    html, pdf = (place / name for name in registration.REPORTS)
    write_document_page(document, html)
    write_document_pdf(document, pdf)
    values = {"session": str(known), "said": view.sentence, "html": str(html), "pdf": str(pdf)}
    shown = [escape(view.sentence), file_line("report", html), file_line("report", pdf)]
    return Report(values=values, shown=shown)


def _document(view: SessionView, refused: list[SpotRefused], checks: dict[str, TakenMarker], folder: Path) -> Document:
    """Return the report of a session."""
    from markerseek.show import Document

    begun = view.begun
    assert begun is not None  # noqa: S101  of a record, which begins with it
    known = view.registration
    matrix = None if known is None else known.report.davinci_to_trus
    blocks = {}
    if matrix is not None:
        rows = "\n".join("  ".join(f"{value:+.9f}" for value in row) for row in matrix)
        blocks["davinci_to_trus, from the left camera to the probe at 0°, translation in metres"] = rows
        command = registration.static_transform_command(matrix, simulated=view.simulated)
        blocks["for ROS 2"] = command
        blocks["for the dVRK, of an arm whose base is its camera"] = registration.dvrk_base_frame(matrix)
    return Document(
        title=f"Registration of the endoscope to the probe, {local_time(begun.begun)}",
        verdict=page.session_verdict(view, next_step=""),
        note="Simulated: this is no measurement on hardware." if view.simulated else None,
        facts=list(_facts(view, folder)),
        figures=list(_figures(view, checks, folder)),
        tables={
            "Markers": _marker_rows(view, checks),
            **_residual_table(view),
            "Left out, and why": _left_out_rows(view),
            "Motion of the endoscope": _motion_rows(view),
            "Spots that were not accepted": _refused_rows(refused),
        },
        blocks=blocks,
    )


def _facts(view: SessionView, folder: Path) -> Iterator[tuple[str, str]]:
    begun = view.begun
    assert begun is not None  # noqa: S101  as above
    yield "rig", begun.description
    yield "images", f"{begun.images}, {begun.size_px[0]} x {begun.size_px[1]} px"
    yield "goal", f"expected error of {1e3 * view.goal_m:g} mm at the target"
    if view.report is not None:
        yield from report_rows(view.report)
    yield from session_rows(view)
    for step in view.measured_again:
        yield f"marker {step.name} again", step.said
    yield "session", str(folder)
    yield (
        "versions",
        f"markerseek {begun.version} (session), {__version__} (report), Python {platform.python_version()}",
    )


def _marker_rows(view: SessionView, checks: dict[str, TakenMarker]) -> Rows:
    chosen = {} if view.last is None else view.last.chosen
    rows: list[tuple[str, ...]] = [("marker", "answer", "angle [deg]", "frames", "time [s]", "taken, UTC", "use")]
    for marker in (*view.markers, *checks.values()):
        number = chosen.get(marker.name, 0)
        angle = f"{marker.candidates[number].angle_deg:.2f}" if marker.candidates else "–"
        use = "checks" if marker.check else view.use_of(marker)
        taken = (
            marker.name,
            marker.answer,
            angle,
            str(marker.acquisitions),
            f"{marker.rig_s:.1f}",
            marker.at[:19],
            use,
        )
        rows.append(taken)
    return rows


def _left_out_rows(view: SessionView) -> Rows:
    why = {
        "left out": "it does not fit the others",
        "open": "another candidate of it, or none, is still too probable",
        "not found": "the search found no marker",
        "lost": "it is not known where the endoscope sees it now",
    }
    out = [(each.name, view.use_of(each), each.reason) for each in view.markers if view.use_of(each) != "used"]
    rows = [(name, f"{why[use]}{'' if reason is None else f': {reason}'}") for name, use, reason in out]
    return [("marker", "reason"), *(rows or [("–", "nothing was left out")])]


def _refused_rows(refused: list[SpotRefused]) -> Rows:
    rows = [(each.name, each.reason) for each in refused]
    return [("marker", "reason"), *(rows or [("–", "all were accepted")])]


def _motion_rows(view: SessionView) -> Rows:
    said = [
        (marker.name, seen.said)
        for marker in view.markers
        for seen in (marker.endoscope, marker.scene)
        if seen is not None
    ]
    return [("marker", "what the images show"), *(said or [("–", "nobody looked: the endoscope is held")])]


def _residual_table(view: SessionView) -> dict[str, Rows]:
    """Return the points of the registration, where there is one."""
    if view.report is None:
        return {}
    rows: list[tuple[str, ...]] = [
        ("point", "x [mm]", "y [mm]", "z [mm]", "residual [mm]", "error if the others alone register [mm]")
    ]
    for point in view.report.points:
        place = (f"{1e3 * value:.2f}" for value in point.trus_m)
        left_out = "–" if point.left_out_m is None else f"{1e3 * point.left_out_m:.2f}"
        rows.append((point.name, *place, f"{1e3 * point.residual_m:.2f}", left_out))
    for check in view.report.checks:
        place = (f"{1e3 * value:.2f}" for value in check.trus_m)
        rows.append((check.name, *place, f"{1e3 * check.off_m:.2f}", "it takes no part"))
    return {"Points in the frame of the probe": rows}


def _figures(view: SessionView, checks: dict[str, TakenMarker], folder: Path) -> Iterator[DocumentFigure]:
    from markerseek.show import DocumentFigure, errors_figure, markers_figure, registration_figure

    views = _camera_views(view, checks, folder)
    if views:
        yield DocumentFigure(
            title="Spots of the markers over the images of both cameras",
            alt="Images of the left and the right camera with the spots of the markers, of the checks, and the target",
            draw=partial(markers_figure, views, title="markers and target in the images"),
        )
    report = view.report
    if report is None:
        return
    yield DocumentFigure(
        title="Residuals in the frame of the probe",
        alt="Markers in the frame of the probe from above and along its axis, with residuals ten times as long",
        draw=partial(
            registration_figure,
            np.array([point.trus_m for point in report.points]),
            np.array([point.transformed_m for point in report.points]),
            names=[point.name for point in report.points],
            target_m=report.target_trus_m,
            checks={each.name: (each.trus_m, each.transformed_m) for each in report.checks},
            title=f"FRE {1e3 * report.fre_m:.2f} mm, {report.expected}",
        ),
    )
    if view.errors:
        errors = [(each.markers, 1e3 * each.tre_m, 1e3 * each.tre95_m) for each in view.errors]
        yield DocumentFigure(
            title="Expected error, marker by marker",
            alt="Expected error at the target after each marker, and the goal",
            draw=partial(errors_figure, errors, goal_mm=1e3 * view.goal_m),
        )


def _camera_views(view: SessionView, checks: dict[str, TakenMarker], folder: Path) -> list[CameraView]:
    """Return what both cameras saw from each place of the endoscope at which markers were taken."""
    from markerseek.show import CameraView

    begun = view.begun
    assert begun is not None  # noqa: S101  as above
    stereo = msgspec.json.decode(begun.cameras, type=StereoSettings)
    stations = registration.station_names(view.markers)
    found = []
    places = list(dict.fromkeys(stations.values()))
    for station in places:
        is_last = station == places[-1]
        here = [each for each in view.markers if stations[each.name] == station]
        pair = registration.kept_pair(folder, station) or (registration.newest_pair(folder) if is_last else None)
        of_these = {each.check.name for each in view.checks if view.last and each.chosen == view.last.chosen}
        for number, (side, camera) in enumerate((("left", stereo.left), ("right", stereo.right))):
            spots = {each.name: getattr(each.spot, f"{side}_px") for each in here}
            used = {each.name: spots[each.name] for each in here if view.use_of(each) == "used"}
            found.append(
                CameraView(
                    title=f"{side} camera" + ("" if len(places) == 1 else f" from marker {station} on"),
                    image=None if pair is None else getattr(pair, side),
                    size_px=camera.size_px,
                    used=used,
                    others={name: spot for name, spot in spots.items() if name not in used},
                    checks={
                        name: getattr(each.spot, f"{side}_px")
                        for name, each in checks.items()
                        if is_last and name in of_these
                    },
                    target=_target(view, stereo, number) if is_last else None,
                )
            )
    return found


def _target(view: SessionView, stereo: StereoSettings, number: int) -> registration.Pixel | None:
    """Return the target in the image of a camera; None without a registration, or behind the camera."""
    if view.registration is None:
        return None
    try:
        return registration.target_pixels(view.registration.report, stereo=stereo)[number]
    except ConfigError:
        return None
