"""``markerseek register``: registers the da Vinci system to the probe from markers and camera points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from msgspec.structs import replace
from rich.markup import escape
from rich.table import Table

from markerseek import registration
from markerseek.cli.in_options import in_options
from markerseek.cli.options import AsJson, Out, with_values
from markerseek.cli.registering import SessionArguments, SessionOver, SessionPlace, require_no_session, run_session
from markerseek.cli.registration_rows import report_rows, session_rows
from markerseek.cli.registrations import sessions_report
from markerseek.cli.report import Output, Report, drawn, facts, file_line, matrix_lines, table
from markerseek.core import ConfigError, RecordError, SceneOptions, SpotToSource

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _file_of(report: registration.RegistrationReport, *, force: bool) -> dict[Path, bytes]:
    """Return the file of a registration, and its content.

    Only ``force`` replaces another registration in this folder.
    """
    path = Path(registration.REGISTRATION_FILE)
    if registration.session_folder(path) is not None:
        raise ConfigError(
            "the current folder holds a registration session, whose file registration.json is; run the command in "
            "another folder"
        )
    if path.exists() and not force:
        try:
            known = registration.read_registration(path).davinci_to_trus.matrix.tolist()
        except RecordError:
            known = None
        if known != report.davinci_to_trus:
            raise ConfigError(
                f"{path}: another registration is in this folder; --force replaces it, or run the command in "
                "another folder"
            )
    return {path: msgspec.json.format(msgspec.json.encode(report))}


@with_values
def command(
    *,
    points: Annotated[
        Path | None,
        typer.Argument(
            help="CSV with trus_x_m … trus_z_m and camera_x_m … camera_z_m in metres; optional are name, "
            "trus_sigma_x_m …, camera_sigma_x_m …; with --list the folder of sessions"
        ),
    ] = None,
    journal: Annotated[
        list[Path] | None,
        typer.Option(
            help="Journal or JSON result of a search, in place of the trus columns; give the option once for each "
            "row of the CSV, in the same order."
        ),
    ] = None,
    cameras: Annotated[
        list[Path] | None,
        typer.Option(
            help="Calibration of the stereo endoscope: TOML, StereoCalibrationDVRK.ini of a dVRK, or YAML, XML or JSON "
            "of OpenCV. Give the option twice for two files, for example left and right YAML files of ROS. The CSV "
            "then has left_x_px, left_y_px, right_x_px, right_y_px in place of the camera columns, and optionally "
            "spot_sigma_px."
        ),
    ] = None,
    calibration_sigma_px: Annotated[
        float | None,
        typer.Option(help="Reprojection error of that calibration, in pixels, if its file does not state it."),
    ] = None,
    frames: Annotated[
        tuple[Path, Path] | None,
        typer.Option(
            metavar="LEFT RIGHT",
            help="Images of the laser spots in place of a CSV: two folders, one for each camera. Each has a folder of "
            "PNG files for each marker, with the name of its journal.",
        ),
    ] = None,
    target_mm: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y Z",
            help="Point at which the error is computed, in the TRUS frame.",
            show_default="20 mm under the middle of the points",
        ),
    ] = None,
    spot_depth_mm: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="DEPTH SIGMA",
            help="The camera points are spots of light, which is absorbed this deep below them, along the view: mean "
            "and standard deviation. Only points with sigmas use it.",
            show_default="0.3 0.3 for --frames; 0 0 for a CSV",
        ),
    ] = None,
    without: Annotated[list[str] | None, typer.Option(help="Name of a point to leave out; may be repeated.")] = None,
    list_: Annotated[
        bool,
        typer.Option(
            "--list",
            help="List the sessions of a folder, the newest first; without a folder those in the user's data folder.",
        ),
    ] = False,
    report_of: Annotated[
        Path | None,
        typer.Option(
            "--report",
            metavar="FOLDER",
            help="Write report.html and report.pdf of the session of this folder into it, or into --out.",
        ),
    ] = None,
    place: SessionPlace,
    session: registration.SessionPlan,
    simulation: SceneOptions,
    plot: Annotated[bool, typer.Option("--plot", help="Write register.png into --out.")] = False,
    out: Out = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace another registration.json in the current folder.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Find the transform from the da Vinci camera to the probe, with its errors.

    With --rig or --simulate, run a session: light a spot on the tissue; both cameras see it, the probe searches for it,
    and the command names the next place, until the expected error is small enough. Otherwise use points, or recorded
    searches and images. At least three markers that are not on a line are needed. A session writes registration.json
    into its own folder. Otherwise the file goes into the current folder, and --force replaces another one there.
    `markerseek igtl --registration` and `markerseek ros2 search --registration` read it. Exit code 3 if the points do
    not fit: their residuals are larger than their sigmas explain (a chi-squared test at 1e-3; without sigmas 1 mm is
    assumed), or a mirror image fits better.

    Examples
    --------
    markerseek register --simulate --sweep --seed 1 --plot
    markerseek register --simulate --sweep --seed 1 --check
    markerseek register --rig rig.toml --cameras stereo.toml --images 'left right' --sweep
    markerseek register --list
    markerseek register --report ~/.local/share/markerseek/registrations/20260801-101500-000000
    markerseek register examples/points.csv
    markerseek register pixels.csv --cameras a.toml --journal a.journal --journal b.journal --journal c.journal
    markerseek register --frames left right --cameras a.ini --journal a.journal --journal b.journal --journal c.journal
    """
    if report_of is not None:
        if place.wanted or points is not None or frames is not None or journal or plot or list_:
            raise ConfigError(f"--report {report_of} writes the report of a session that is kept; leave the others out")
        from markerseek.cli.registration_report import write_report

        Output(as_json=as_json).show(write_report(report_of, out))
    output = Output.asked(as_json=as_json, plot=plot, out=out)
    if list_:
        if place.wanted or frames is not None or journal or cameras or plot:
            raise ConfigError("--list lists sessions; leave all but the folder and --json out")
        output.show(sessions_report(points))
    target_m = None if target_mm is None else (target_mm[0] / 1e3, target_mm[1] / 1e3, target_mm[2] / 1e3)
    if place.wanted:
        if points is not None or frames is not None or journal or without:
            raise ConfigError("a session makes its own points; leave the CSV, --frames, --journal and --without out")
        if spot_depth_mm is not None:
            raise ConfigError("a session takes the depth of [spot] from its rig file; leave --spot-depth-mm out")
        asked = SessionArguments(
            place=place,
            plan=replace(session, target_trus_m=target_m),
            simulation=simulation,
            cameras=cameras or (),
            calibration_sigma_px=calibration_sigma_px,
        )
        output.show(_of_session(run_session(asked, as_json=as_json)))
    require_no_session(place, session, simulation)
    title, pairs = _pairs(points, frames, journal or (), cameras, calibration_sigma_px)
    spot = _spot(spot_depth_mm, is_seen=frames is not None)
    report = registration.register_pairs(pairs, target_trus_m=target_m, without=without or (), spot=spot)
    heading = f"{title}: FRE {1e3 * report.fre_m:.2f} mm, expected TRE {1e3 * report.tre_m:.2f} mm"
    shown = Report(
        values=msgspec.to_builtins(report),
        shown=_shown(report, title, []),
        pictures={"register.png": drawn(_figure, report, heading)},
        files=_file_of(report, force=force) if report.registered else {},
        exit_code=0 if report.registered else 3,
    )
    output.show(shown)


def _spot(depth_mm: tuple[float, float] | None, *, is_seen: bool) -> SpotToSource | None:
    """Return where light is absorbed, as stated.

    If it is not stated, it is the usual one for spots of light, and None for points of a table.
    """
    if depth_mm is None:
        return SpotToSource() if is_seen else None
    depth, sigma = depth_mm
    return SpotToSource(depth_m=depth / 1e3, depth_sigma_m=sigma / 1e3)


def _of_session(over: SessionOver) -> Report:
    """Return the report of a session, whose registration is in the folder of the session."""
    report = over.report
    view = over.view
    registered = view.registration is not None
    heading = f"{over.title}: expected TRE {1e3 * report.tre_m:.2f} mm after {len(view.markers)} markers"
    values = msgspec.to_builtins(report) | {
        "decided": registered,
        "endoscope": None if view.endoscope is None else view.endoscope.shown,
        "goal_m": view.goal_m,
        "goal_reached": view.goal_reached,
        "left_out": list(view.left_out),
        "lost": list(view.lost),
        "rig_s": view.rig_s,
        "scenes": {marker.name: marker.scene.shown for marker in view.markers if marker.scene is not None},
        "session": str(over.folder),
    }
    if over.truth is not None:
        values |= {"simulation": msgspec.to_builtins(over.truth)}
    return Report(
        values=values,
        shown=_shown(
            report,
            over.title,
            session_rows(over.view, over.truth),
            above_goal_m=None if view.goal_reached else view.goal_m,
            simulated=view.simulated,
        ),
        pictures={"register.png": drawn(_figure, report, heading)},
        notes=(file_line("registration", over.folder / registration.REGISTRATION_FILE),) if registered else (),
        exit_code=0 if registered else 3,
    )


def _pairs(
    points: Path | None,
    frames: tuple[Path, Path] | None,
    searches: Sequence[Path],
    cameras: Sequence[Path] | None,
    calibration_sigma_px: float | None,
) -> tuple[str, list[registration.PointPair]]:
    """Return the title and pairs of the points."""
    if points is None and frames is None:
        raise ConfigError(
            "no points: name a CSV, images by --frames LEFT RIGHT, a rig for a session by --rig RIG.toml, or add "
            "--simulate"
        )
    if points is not None and frames is not None:
        raise ConfigError(f"{points} and --frames {frames[0]} {frames[1]} both give points; leave one out")
    if not cameras and calibration_sigma_px is not None:
        raise ConfigError("--calibration-sigma-px belongs to a calibration; name it by --cameras, or leave it out")
    stereo = registration.read_stereo(cameras, calibration_sigma_px=calibration_sigma_px) if cameras else None
    if frames is None:
        assert points is not None  # noqa: S101  one of the two, by the checks above
        return points.name, registration.point_pairs(points, searches=searches, stereo=stereo)
    if stereo is None:
        raise ConfigError("--frames gives pixels; name the calibration of the endoscope by --cameras FILE")
    left, right = frames
    return f"{left} and {right}", registration.spot_pairs(left, right, searches=searches, stereo=stereo)


def _shown(
    report: registration.RegistrationReport,
    title: str,
    more: list[tuple[str, str]],
    *,
    above_goal_m: float | None = None,
    simulated: bool = False,
) -> Iterator[str | Table]:
    """Yield what people get of a registration.

    ``above_goal_m``: goal of its session, where that is not reached. ``simulated``: whether markers and camera were.
    """
    answer = "[bold green]registered[/]" if report.registered else "[bold yellow]not registered[/]"
    if report.registered and above_goal_m is not None:
        answer = f"[bold yellow]registered above the goal of {1e3 * above_goal_m:g} mm[/]"
    yield f"{answer}: {escape(title)}, {len(report.points)} points"
    if report.reason is not None:
        yield escape(in_options(report.reason))
    yield facts([*report_rows(report), *more])
    yield table(
        {
            "point": point.name,
            **{f"{axis} [mm]": f"{1e3 * value:.2f}" for axis, value in zip("xyz", point.trus_m, strict=True)},
            "residual [mm]": f"{1e3 * point.residual_m:.2f}",
            "without it [mm]": "–" if point.left_out_m is None else f"{1e3 * point.left_out_m:.2f}",
        }
        for point in report.points
    )
    if report.davinci_to_trus is not None:
        yield "[dim]davinci_to_trus, translation in metres:[/]"
        yield from matrix_lines(report.davinci_to_trus)
        yield "[dim]for ROS 2:[/]"
        yield escape(registration.static_transform_command(report.davinci_to_trus, simulated=simulated))
        yield "[dim]for the dVRK, of an arm whose base is its camera:[/]"
        yield escape(registration.dvrk_base_frame(report.davinci_to_trus))


def _figure(report: registration.RegistrationReport, title: str) -> Figure:
    import numpy as np

    from markerseek.show import registration_figure

    return registration_figure(
        np.array([point.trus_m for point in report.points]),
        np.array([point.transformed_m for point in report.points]),
        names=[point.name for point in report.points],
        target_m=report.target_trus_m,
        title=title + ("" if report.registered else " (not accepted)"),
    )
