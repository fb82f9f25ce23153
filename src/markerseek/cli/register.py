"""``markerseek register``: registers the da Vinci system to the probe from markers and camera points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from markerseek.runs import PointPair

NAME = "register"
EXAMPLES = (
    "Examples:\n\n"
    "  markerseek register examples/points.csv\n\n"
    "  markerseek register camera.csv --journal a.journal --journal b.journal --journal c.journal\n\n"
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
    target_mm: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            help="Where the error is wanted, in the TRUS frame.", show_default="20 mm under the middle of the points"
        ),
    ] = None,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Search markers on the simulated rig, and simulate the camera.")
    ] = False,
    markers: Annotated[int, typer.Option(help="Number of simulated markers: 3, 4, 6 or 9.")] = 4,
    camera_mm: Annotated[float, typer.Option(help="Distance of the simulated camera from the tissue.")] = 100.0,
    frames: Annotated[int, typer.Option(help="Simulated camera frames of each spot.")] = 25,
    tissue: Annotated[str | None, typer.Option(help="Simulated material.", show_default="plastisol-phantom")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the simulation.", show_default="1")] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Write register.png into --out.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the picture, with --plot.", show_default="the current one")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")] = False,
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
        if seed is not None or tissue is not None:
            raise ConfigError("--seed and --tissue are for --simulate; leave them out")
        report = register_pairs(point_pairs(points, journal or []), target_trus_m=target_m)
        conclude(report, None, title=points.name, as_json=as_json, picture=picture)
    if points is not None or journal:
        raise ConfigError("--simulate makes its own points; leave the CSV and --journal out")
    scene = SimulatedScene(
        markers=markers,
        camera_m=camera_mm / 1e3,
        camera=EndoscopeSettings(frames=frames),
        rig=SimulatedSettings() if tissue is None else SimulatedSettings(tissue=tissue),
    )
    announce_compilation()
    with progress_bar(markers, what="searching markers") as progress:
        report, truth = simulate_registration(
            scene,
            seed=1 if seed is None else seed,
            target_trus_m=target_m,
            on_search=lambda number: progress.update(progress.task_ids[0], completed=number),
        )
    conclude(report, truth, title="simulated rig and camera", as_json=as_json, picture=picture)


def point_pairs(points: Path, searches: list[Path]) -> list[PointPair]:
    """Point pairs of a CSV, with the markers of searches in place of its columns for the TRUS frame.

    Parameters
    ----------
    points
        The CSV.
    searches
        Journals or results, one for each row; none: the CSV has these columns.

    Raises
    ------
    ConfigError
        If the CSV and the searches do not go together.
    RecordError
        If a file cannot be read.
    """
    import numpy as np

    from markerseek.core import ConfigError
    from markerseek.runs import PointPair, read_marker, read_points

    rows = read_points(points)
    if searches and len(searches) != len(rows):
        raise ConfigError(
            f"{len(searches)} searches and {len(rows)} rows of {points}; give --journal once for each row, in order"
        )
    pairs = []
    for number, row in enumerate(rows):
        if row.camera_m is None:
            raise ConfigError(f"{points}: the columns camera_x_m, camera_y_m, camera_z_m are missing")
        if searches and row.trus_m is not None:
            raise ConfigError(f"{points}: it has the columns trus_x_m …, and --journal gives the same; leave one out")
        if not searches and row.trus_m is None:
            raise ConfigError(
                f"{points}: the columns trus_x_m, trus_y_m, trus_z_m are missing; add them, or name the searches by "
                "--journal"
            )
        marker = read_marker(searches[number]) if searches else None
        trus_covariance = None if row.trus_sigma_m is None else np.diag(np.square(row.trus_sigma_m))
        pairs.append(
            PointPair(
                name=row.name,
                trus_m=np.array(row.trus_m if marker is None else marker.position_m),
                camera_m=np.array(row.camera_m),
                trus_covariance_m2=trus_covariance if marker is None else marker.covariance_m2,
                camera_covariance_m2=None if row.camera_sigma_m is None else np.diag(np.square(row.camera_sigma_m)),
            )
        )
    return pairs
