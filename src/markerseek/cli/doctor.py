"""``markerseek doctor``: whether everything is here that a search needs."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import platform
import time
import warnings
from typing import Annotated, Literal

import msgspec
import typer

NAME = "doctor"
EXAMPLES = "Examples:\n\n  markerseek doctor\n\n  markerseek doctor --json"

REQUIRED = ("numpy", "scipy", "numba", "msgspec", "typer", "rich", "jaxtyping")
EXTRAS = {"plot": "matplotlib", "cluster": "distributed"}


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that was looked at."""

    what: str
    state: Literal["ok", "missing", "broken"]
    detail: str
    needed: bool = True


def command(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")] = False,
) -> None:
    """Look at the installation, and run one short simulated search (which compiles the kernels if need be)."""
    from markerseek.cli.terminal import people, print_json

    findings = [*_packages(), _search()]
    ok = all(finding.state == "ok" for finding in findings if finding.needed)
    if as_json:
        print_json({"ok": ok, "findings": findings})
    else:
        for finding in findings:
            colour = "green" if finding.state == "ok" else ("red" if finding.needed else "yellow")
            people.print(f"[{colour}]{finding.state:>8}[/]  {finding.what}: {finding.detail}", markup=True)
    raise typer.Exit(0 if ok else 1)


def _packages() -> list[Finding]:
    """Python, the packages that are needed, and those of the extras."""
    found = [Finding(what="Python", state="ok", detail=platform.python_version())]
    found += [Finding(what=name, state="ok", detail=importlib.metadata.version(name)) for name in REQUIRED]
    for extra, package in EXTRAS.items():
        if importlib.util.find_spec(package) is None:
            cure = f"not installed; pip install 'markerseek[{extra}]'"
            found.append(Finding(what=package, state="missing", detail=cure, needed=False))
        else:
            version = importlib.metadata.version(package)
            found.append(Finding(what=package, state="ok", detail=f"{version} (extra {extra})", needed=False))
    return found


def _search() -> Finding:
    """One short search on the simulated rig, which leaves the compiled kernels on disk."""
    from markerseek import rigs
    from markerseek.records.result import Recorder
    from markerseek.scan import run
    from markerseek.search import build

    began_s = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        rig = rigs.simulated(seed=1, marker_deg=10.0)
        recorder = Recorder()
        policy = build("weighted-average", limits=rig.limits.search, start_deg=rig.stage.angle_deg)
        for event in run(policy, rig.scanner, dark_frames=rig.dark_frames):
            recorder.hear(event)
    took_s = time.perf_counter() - began_s
    finished = recorder.finished
    if finished is None or not abs(finished.estimate.mean_deg - 10.0) < 2.0:
        return Finding(what="simulated search", state="broken", detail="the marker at 10 deg was not found")
    remarks = "".join(f"; {warning.message}" for warning in caught)
    detail = f"found {finished.estimate.mean_deg:.2f} deg for 10 deg in {took_s:.1f} s{remarks}"
    return Finding(what="simulated search", state="ok", detail=detail)
