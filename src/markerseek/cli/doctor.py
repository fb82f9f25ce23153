"""``markerseek doctor``: checks the installation, and optionally a rig and its sense of rotation."""

from __future__ import annotations

import math
import os
import platform
import time
import warnings
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
import typer
from rich.markup import escape

from markerseek import drivers, rigs, ros, runs
from markerseek.cli import NO_MACHINE_CODE, without_machine_code
from markerseek.cli.open_rig import arm_rig, open_rig
from markerseek.cli.options import AsJson, Trace
from markerseek.cli.report import Output, Report
from markerseek.cli.terminal import progress_bar
from markerseek.contract import RuleCheck
from markerseek.core import (
    ConfigError,
    DeviceError,
    Finished,
    Measured,
    SearchPlan,
    described,
    extra_install,
    is_absent,
)

if TYPE_CHECKING:
    from markerseek.show import SearchResult

REQUIRED = ("numpy", "scipy", "numba", "msgspec", "typer", "rich", "jaxtyping")
EXTRAS = {
    "plot": ("matplotlib", "a picture"),
    "records": ("h5py", "a bank or an export"),
    "devices": ("serial", "a rig of devices, real or emulated,"),
    "page": ("nicegui", "the live page"),
    "igtl": ("pyigtl", "OpenIGTLink"),
    "vision": ("cv2", "a camera or B-mode image"),
    "ros2": ("rclpy", "ROS 2"),
    "notebook": ("pandas", "a result as a DataFrame, or a bank as a data set,"),
}
"""A module of each extra, and what needs it."""


_MARKER_DEG = 10.0
"""Angle of the marker in the two simulated searches, in degrees."""


class CheckResult(msgspec.Struct, frozen=True, kw_only=True):
    """Result of one check."""

    what: str
    state: Literal["ok", "absent", "broken"]
    detail: str
    needed: bool = True


def command(
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML): connect to its devices too, without moving or firing.")
    ] = None,
    source_deg: Annotated[
        float | None,
        typer.Option(help="True angle of a point source, in degrees: search for it, to test the sense of rotation."),
    ] = None,
    arm: Annotated[bool, typer.Option("--arm", help="Arm the rig for --source-deg without being asked.")] = False,
    trace: Trace = None,
    as_json: AsJson = False,
) -> None:
    """Check the installation and a rig, and run two simulated searches (which compiles the kernels if necessary).

    With --trace all that its devices say is written to a file: during the search of --source-deg, or without it for a
    minute, at rest and without light; Ctrl-C ends that earlier.

    With --source-deg the rig moves and fires, once a person has armed it: a source that is placed at a known angle must
    be found there. A probe that is mounted the other way round finds it at the mirrored angle; no other check detects
    this. Place it at least 5 degrees from 0, at another angle than the source used to calibrate zero_deg.

    Examples
    --------
    markerseek doctor
    markerseek doctor --json
    markerseek doctor --rig examples/rigs/bench.toml
    markerseek doctor --rig examples/rigs/bench.toml --source-deg 12.5 --arm
    markerseek doctor --rig examples/rigs/bench.toml --trace devices.txt
    """
    if trace is not None and rig is None:
        raise ConfigError(f"--trace is {trace}, and no rig is named; name one with --rig RIG.toml")
    if rig is None and source_deg is not None:
        raise ConfigError(f"--source-deg is {source_deg:g} deg, and no rig is named; name one with --rig RIG.toml")
    if source_deg is None and arm:
        raise ConfigError("--arm: without --source-deg nothing moves and nothing is fired; leave it out")
    if source_deg is not None:
        require_source_deg(source_deg)
    if rig is not None:
        rigs.read_rig_file(rig)
    findings = [*_packages(), _search("weighted-average"), _search("posterior")]
    if rig is not None:
        # A search is traced as well, and Ctrl-C before it must not lead to it.
        findings += _rig(rig, trace=trace, listen=trace is not None and source_deg is None)
        if source_deg is not None and all(finding.state == "ok" for finding in findings if finding.needed):
            right, detail = prove_direction(rig, source_deg=source_deg, arm=arm, as_json=as_json, trace=trace)
            findings.append(CheckResult(what="sense of rotation", state="ok" if right else "broken", detail=detail))
    ok = all(finding.state == "ok" for finding in findings if finding.needed)
    shown = (f"{_STATES[each.state, each.needed]}  {escape(f'{each.what}: {each.detail}')}" for each in findings)
    Output(as_json=as_json).show(Report(values={"ok": ok, "findings": findings}, shown=shown, exit_code=int(not ok)))


_STATES = {
    ("ok", True): "[green]      ok[/]",
    ("ok", False): "[green]      ok[/]",
    ("absent", False): "[dim]optional[/]",
    ("broken", True): "[red]  broken[/]",
    ("broken", False): "[yellow] warning[/]",
}
"""States as printed, of what is needed and of what is not."""


def _packages() -> list[CheckResult]:
    """Return the Python, the packages that are needed, and those of the extras."""
    import importlib.metadata

    found = [CheckResult(what="Python", state="ok", detail=platform.python_version()), *_python_path()]
    # Installed in any case: without them this command would not have started.
    found += [CheckResult(what=name, state="ok", detail=importlib.metadata.version(name)) for name in REQUIRED]
    # A module may come from a package of another name, as cv2 does, or of a system, as rclpy.
    packages_of = importlib.metadata.packages_distributions()
    for extra, (module, purpose) in EXTRAS.items():
        try:
            if module == "rclpy":
                # With a middleware that is not installed, the import would end this process.
                ros.require_middleware()
            importlib.import_module(module)
        # A library that is broken raises any error.
        except (Exception, SystemExit) as problem:  # noqa: BLE001
            if is_absent(module, problem):
                cure = f"not installed; {purpose} needs it: {extra_install(extra)}"
                found.append(CheckResult(what=module, state="absent", detail=cure, needed=False))
            else:
                cause = f"it cannot be imported, and {purpose} needs it: {described(problem)}"
                found.append(CheckResult(what=module, state="broken", detail=cause, needed=False))
        else:
            packages = packages_of.get(module)
            version = importlib.metadata.version(packages[0]) if packages else "of the system"
            found.append(CheckResult(what=module, state="ok", detail=f"{version} (extra {extra})", needed=False))
    return found


def _python_path() -> list[CheckResult]:
    """Return whether PYTHONPATH names the current folder, as an empty element does; nothing if it does not."""
    # If the variable is empty as a whole, Python takes it as not set.
    named = os.environ.get("PYTHONPATH", "")
    if not named or not {"", "."}.intersection(named.split(os.pathsep)):
        return []
    detail = (
        f"{named!r} names the current folder, by an empty element or a point, so that a file there is imported in "
        "place of a library of its name; leave that element out"
    )
    return [CheckResult(what="PYTHONPATH", state="broken", detail=detail, needed=False)]


def _rig(path: Path, *, trace: Path | None, listen: bool) -> list[CheckResult]:
    """Return whether the devices of a rig file answer and are fit for use, and what foreign drivers were tried by."""
    try:
        with open_rig(path, trace=trace) as (rig, stands_deg):
            detail = f"{rig.facts.description}; stands at {stands_deg:.3f} deg, inside {rig.limits.travel}"
            checks = rig.checks
            if listen:
                _listen(rig)
    except DeviceError as error:
        return [CheckResult(what=str(path), state="broken", detail=str(error))]
    found = [
        CheckResult(what=f"contract of {device}", state="ok", detail=_kept(each)) for device, each in checks.items()
    ]
    return [*found, CheckResult(what=str(path), state="ok", detail=detail)]


_LISTENED_S = 60
"""Time for which devices at rest are traced, in seconds."""


def _listen(rig: rigs.Rig) -> None:
    """Read the stage once a second, so that a trace shows what the devices say at rest; Ctrl-C ends it."""
    with suppress(KeyboardInterrupt), progress_bar(_LISTENED_S, what="listening") as progress:
        for _ in range(_LISTENED_S):
            rig.scanner.clock.wait(1.0)
            _ = rig.stage.angle_deg
            progress.advance(progress.task_ids[0])


def _kept(checks: tuple[RuleCheck, ...]) -> str:
    """Return the rules that were kept."""
    return f"kept without a move or light: {'; '.join(check.rule for check in checks)}"


def _search(method: str) -> CheckResult:
    """Return one search on the simulated rig, which leaves the compiled kernels on disk."""
    what = f"simulated search, {method}"
    began_s = time.perf_counter()
    # A warning of NumPy or Numba here hints at a broken installation: it is printed with the result.
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found_deg = _found_deg(method)
        except OSError as problem:
            if not without_machine_code(problem):
                raise
            return CheckResult(what=what, state="broken", detail=NO_MACHINE_CODE)
    took_s = time.perf_counter() - began_s
    if not abs(found_deg - _MARKER_DEG) < 1:
        return CheckResult(what=what, state="broken", detail=f"found {found_deg:.2f} deg for {_MARKER_DEG:g} deg")
    remarks = "".join(f"; {warning.message}" for warning in caught)
    return CheckResult(
        what=what, state="ok", detail=f"found {found_deg:.2f} deg for {_MARKER_DEG:g} deg in {took_s:.1f} s{remarks}"
    )


def _found_deg(method: str) -> float:
    """Search the marker of a simulated rig, and return its angle in degrees."""
    from markerseek.scan import run
    from markerseek.search import build

    rig = rigs.simulated(seed=1, marker_deg=_MARKER_DEG)
    policy = build(SearchPlan(method=method, start_deg=rig.stage.angle_deg), limits=rig.limits.search)
    found_deg = math.nan
    for event in run(policy, rig.scanner, rig.run_plan):
        if isinstance(event, Measured) and event.role == "confirmation" and rig.imaging and event.sample.frame:
            # Compiles the kernels of `markerseek frame`, too, which a search does not use.
            rig.imaging.findings(event.sample.frame)
        elif isinstance(event, Finished):
            found_deg = event.estimate.mean_deg
    return found_deg


MIN_DEG = 5.0
"""Smallest angle of a source at which its two sides can be distinguished, in degrees."""

_NEAR_DEG = 5.0
"""Largest accepted difference of the angle found, in degrees; at small angles half of the angle, if less."""

_Sense = Literal["right", "mirrored", "neither"]


def sense_of(found_deg: float, source_deg: float) -> _Sense:
    """Return whether a source was found at its true angle, at the mirrored angle, or elsewhere; both in degrees."""
    # With the full tolerance a source at 5 deg could be found at 0, which is neither side.
    near_deg = min(_NEAR_DEG, abs(source_deg) / 2)
    if abs(found_deg - source_deg) <= near_deg:
        return "right"
    return "mirrored" if abs(found_deg + source_deg) <= near_deg else "neither"


def steadiness(spread: float | None) -> str:
    """Return how steady the laser is, in words.

    ``spread`` is the relative standard deviation of an acquisition's energy.
    """
    if spread is None:
        return "too few samples show how steady the laser is"
    return f"the laser's energy differs by {spread:.1%} from one acquisition to the next"


def _usual_energy(rig: rigs.Rig) -> str:
    """Return what the rig's energy meter says of a usual pulse, for the rig file; empty if it has none."""
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


def _not_found(result: SearchResult, source_deg: float) -> str:
    """Return why a search that has not found the source proves nothing, and that it is mirrored where it looks so."""
    why = f"no source was found ({result.answer}: {result.reason})"
    mirrored = result.answer != "not found" and sense_of(result.angle_deg, source_deg) == "mirrored"
    if not mirrored:
        return f"{why}; place one point source, and no other"
    return (
        f"{why}, but there is something at {result.angle_deg:.2f} deg, the mirrored angle of {source_deg:g} deg: the "
        "stage seems to turn the other way round; change stage.direction, and search again"
    )


def prove_direction(
    path: Path, *, source_deg: float, arm: bool, as_json: bool, trace: Path | None = None
) -> tuple[bool, str]:
    """Search a source at a known angle, and return whether the stage turns the right way, with what was found in words.

    ``source_deg``: true angle of the source on the probe's scale; see `require_source_deg`. ``arm``: whether the user
    armed the rig by an option; otherwise a question is asked on the terminal. ``as_json``: whether a program reads the
    output.
    """
    from markerseek.cli.searching import run_anew
    from markerseek.search.posterior import energy_spread

    with open_rig(path, trace=trace) as (rig, start_deg):
        search = rig.limits.search
        if source_deg not in search or -source_deg not in search:
            raise ConfigError(
                f"--source-deg is {source_deg:g} deg: it or the mirrored angle lies outside limits.search {search}; "
                "place the source nearer to 0"
            )
        run = runs.new_run(rig, runs.plan_on(rig, SearchPlan(method="posterior", start_deg=start_deg)))
        arm_rig(rig, file=path, arm=arm, what=f"search the source at {source_deg:g} deg", as_json=as_json)
        run = run_anew(run, as_json=as_json, rig_file=path)
    result = run.result()
    if not result.found:
        return False, _not_found(result, source_deg)
    spread = energy_spread(run.view.samples, limits=search)
    usual = _usual_energy(rig)
    found = f"the source at {source_deg:g} deg was found at {result.angle_deg:.2f} deg; {steadiness(spread)}{usual}"
    match sense_of(result.angle_deg, source_deg):
        case "right":
            return True, f"{found}: the stage turns the right way"
        case "mirrored":
            return False, f"{found}, the mirrored angle: the stage turns the other way round; change stage.direction"
        case "neither":
            return False, f"{found}: check --source-deg, zero_deg and stage.direction, and calibrate again"
