"""``markerseek register``: registers the da Vinci system to the probe from markers and camera points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from markerseek.cli.output_options import AsJson, Out

if TYPE_CHECKING:
    import numpy as np

    from markerseek.core import Float64
    from markerseek.runs import PointPair, PointRow, StereoSettings

NAME = "register"
EXAMPLES = (
    "Examples:\n\n"
    "  markerseek register examples/points.csv\n\n"
    "  markerseek register pixels.csv --cameras stereo.toml --journal a.journal --journal b.journal --journal c.journal"
    "\n\n"
    "  markerseek register --simulate --markers 4 --seed 1 --plot"
)


def command(
    points: Annotated[
        Path | None,
        typer.Argument(
            help="CSV with trus_x_m … trus_z_m and camera_x_m … camera_z_m in metres; optional are name, "
            "trus_sigma_x_m …, camera_sigma_x_m …"
        ),
    ] = None,
    journal: Annotated[
        list[Path] | None,
        typer.Option(
            help="Journal or JSON result of the search for each row of the CSV, in its order, in place of the trus "
            "columns; give it once for each."
        ),
    ] = None,
    cameras: Annotated[
        Path | None,
        typer.Option(
            help="Calibration of the stereo endoscope (TOML); the CSV then has left_x_px, left_y_px, right_x_px, "
            "right_y_px in place of the camera columns, and optionally spot_sigma_px."
        ),
    ] = None,
    target_mm: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            help="Where the error is wanted, in the TRUS frame.", show_default="20 mm under the middle of the points"
        ),
    ] = None,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Search markers on the simulated rig, and simulate the camera.")
    ] = False,
    markers: Annotated[
        int | None, typer.Option(help="Number of simulated markers: 3, 4, 6 or 9.", show_default="4")
    ] = None,
    camera_mm: Annotated[
        float | None, typer.Option(help="Distance of the simulated camera from the tissue.", show_default="100")
    ] = None,
    frames: Annotated[int | None, typer.Option(help="Simulated camera frames of each spot.", show_default="25")] = None,
    tissue: Annotated[str | None, typer.Option(help="Simulated material.", show_default="plastisol-phantom")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the simulation.", show_default="1")] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Write register.png into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Find the transform from the da Vinci camera to the probe, with its errors.

    At least three markers that are not on a line. Exit code 3 if the points do not fit: FRE above 5 mm, or a mirror
    image that fits better.
    """
    from markerseek.cli.show_registration import conclude
    from markerseek.cli.terminal import announce_compilation, picture_folder, progress_bar
    from markerseek.core import ConfigError
    from markerseek.runs import SimulatedScene, register_pairs, simulate_registration
    from markerseek.sim import EndoscopeSettings, SimulatedSettings

    picture = picture_folder(out, plot=plot) / "register.png" if plot else None
    target_m = None if target_mm is None else (target_mm[0] / 1e3, target_mm[1] / 1e3, target_mm[2] / 1e3)
    if not simulate:
        if points is None:
            raise ConfigError("no points: name a CSV, or add --simulate")
        if any(value is not None for value in (markers, camera_mm, frames, tissue, seed)):
            raise ConfigError(
                "--markers, --camera-mm, --frames, --tissue and --seed are for --simulate; leave them out"
            )
        report = register_pairs(point_pairs(points, searches=journal or [], cameras=cameras), target_trus_m=target_m)
        conclude(report, None, title=points.name, as_json=as_json, picture=picture)
    if points is not None or journal or cameras is not None:
        raise ConfigError("--simulate makes its own points; leave the CSV, --journal and --cameras out")
    scene = SimulatedScene(
        markers=4 if markers is None else markers,
        camera_m=0.1 if camera_mm is None else camera_mm / 1e3,
        camera=EndoscopeSettings(frames=25 if frames is None else frames),
        rig=SimulatedSettings() if tissue is None else SimulatedSettings(tissue=tissue),
    )
    announce_compilation()
    with progress_bar(scene.markers, what="searching markers") as progress:
        report, truth = simulate_registration(
            scene,
            seed=1 if seed is None else seed,
            target_trus_m=target_m,
            on_search=lambda number: progress.update(progress.task_ids[0], completed=number),
        )
    conclude(report, truth, title="simulated rig and camera", as_json=as_json, picture=picture)


def point_pairs(points: Path, *, searches: list[Path], cameras: Path | None) -> list[PointPair]:
    """Point pairs of a CSV, of the searches that take the place of its columns for the TRUS frame, and of pixels.

    Parameters
    ----------
    points
        The CSV.
    searches
        Journals or results, one for each row; none: the CSV has these columns.
    cameras
        Calibration with which its pixels are triangulated; None: it has the columns of camera points.

    Raises
    ------
    ConfigError
        If the files do not go together.
    RecordError
        If one cannot be read.
    """
    from markerseek.core import ConfigError
    from markerseek.runs import PointPair, read_marker, read_points, read_stereo

    rows = read_points(points)
    if searches and len(searches) != len(rows):
        raise ConfigError(
            f"{len(searches)} searches and {len(rows)} rows of {points}; give --journal once for each row, in order"
        )
    stereo = None if cameras is None else read_stereo(cameras)
    pairs = []
    for number, row in enumerate(rows):
        _require_columns(row, points, searched=bool(searches), stereo=stereo is not None)
        camera_m, camera_covariance = _camera_point(row, stereo)
        marker = read_marker(searches[number]) if searches else None
        pairs.append(
            PointPair(
                name=row.name,
                trus_m=_array(row.trus_m if marker is None else marker.position_m),
                camera_m=camera_m,
                trus_covariance_m2=_covariance(row.trus_sigma_m) if marker is None else marker.covariance_m2,
                camera_covariance_m2=camera_covariance,
            )
        )
    return pairs


def _require_columns(row: PointRow, points: Path, *, searched: bool, stereo: bool) -> None:
    """Refuse a table whose columns do not go with the options."""
    from markerseek.core import ConfigError

    if searched and row.trus_m is not None:
        raise ConfigError(f"{points}: it has the columns trus_x_m …, and --journal gives the same; leave one out")
    if not searched and row.trus_m is None:
        raise ConfigError(
            f"{points}: the columns trus_x_m, trus_y_m, trus_z_m are missing; add them, or name the searches by "
            "--journal"
        )
    if stereo and row.pixels is None:
        raise ConfigError(f"{points}: --cameras needs the columns left_x_px, left_y_px, right_x_px, right_y_px")
    if stereo and row.camera_m is not None:
        raise ConfigError(f"{points}: it has camera points and pixels; leave the columns of one out")
    if not stereo and row.pixels is not None and row.camera_m is None:
        raise ConfigError(f"{points}: it has pixels; name the calibration of the endoscope by --cameras FILE")
    if not stereo and row.camera_m is None:
        raise ConfigError(f"{points}: the columns camera_x_m, camera_y_m, camera_z_m are missing, or left_x_px …")


def _camera_point(
    row: PointRow, stereo: StereoSettings | None
) -> tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"] | None]:
    """Camera point of a row with its covariance, from the columns or triangulated from the pixels."""
    from markerseek.core import ConfigError
    from markerseek.geometry import triangulate

    if stereo is None or row.pixels is None:
        return _array(row.camera_m), _covariance(row.camera_sigma_m)
    spot_px = row.spot_sigma_px[0] if row.spot_sigma_px else 0.0
    pixels = _array(row.pixels)[None]
    try:
        seen = triangulate(
            pixels[:, :2], pixels[:, 2:], stereo.cameras, sigma_px=math.hypot(spot_px, stereo.calibration_sigma_px)
        )
    except ConfigError as problem:
        raise ConfigError(f"row {row.name}: {problem}") from problem
    return seen.points_m[0], seen.covariances_m2[0]


def _array(values: Sequence[float] | None) -> Float64[np.ndarray, " values"]:
    import numpy as np

    return np.array(values or (), dtype=float)


def _covariance(sigmas_m: Sequence[float] | None) -> Float64[np.ndarray, "3 3"] | None:
    import numpy as np

    return None if sigmas_m is None else np.diag(np.square(sigmas_m))
