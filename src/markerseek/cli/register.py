"""``markerseek register``: registers the da Vinci system to the probe from markers and camera points."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from markerseek import runs
from markerseek.cli.options import AsJson, Out
from markerseek.cli.terminal import announce_compilation, picture_folder, progress_bar
from markerseek.core import ConfigError

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
        pairs = runs.point_pairs(points, searches=journal or (), cameras=cameras)
        report = runs.register_pairs(pairs, target_trus_m=target_m)
        conclude(report, None, title=points.name, as_json=as_json, picture=picture)
    if points is not None or journal or cameras is not None:
        raise ConfigError("--simulate makes its own points; leave the CSV, --journal and --cameras out")
    scene = runs.SimulatedScene(
        markers=4 if markers is None else markers,
        camera_m=0.1 if camera_mm is None else camera_mm / 1e3,
        camera=EndoscopeSettings(frames=25 if frames is None else frames),
        rig=SimulatedSettings() if tissue is None else SimulatedSettings(tissue=tissue),
    )
    announce_compilation()
    with progress_bar(scene.markers, what="searching markers") as progress:
        report, truth = runs.simulate_registration(
            scene,
            seed=1 if seed is None else seed,
            target_trus_m=target_m,
            on_search=lambda number: progress.update(progress.task_ids[0], completed=number),
        )
    conclude(report, truth, title="simulated rig and camera", as_json=as_json, picture=picture)
