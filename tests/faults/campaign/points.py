"""Enumeration of fault points: the first call of a verb fails, then the second, ... until the search completes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from markerseek import rigs
from markerseek.core import (
    AcquisitionError,
    DeviceError,
    DeviceTimeoutError,
    Failed,
    Finished,
    LaserError,
    MoveError,
    Refused,
    RunPlan,
    SearchPlan,
)
from markerseek.guard import State
from markerseek.rigs import Rig
from markerseek.scan import run
from markerseek.search import build
from markerseek.sim import GaussianCurve

VERBS: tuple[tuple[str, str], ...] = (
    ("stage", "move_to"),
    ("stage", "angle_deg"),
    ("stage", "stop"),
    ("laser", "fire"),
    ("laser", "disarm"),
    ("receiver", "arm"),
    ("receiver", "acquire"),
    ("reader", "read"),
)

_MAX_CALLS = 500


class _Blown:
    """Any device, whose n-th call of one verb fails, once or from then on."""

    def __init__(self, inner: object, verb: str, at: int, error: Exception, *, once: bool) -> None:
        self._inner, self._verb, self._at, self._error, self._once = inner, verb, at, error, once
        self.calls = 0

    def __getattr__(self, name: str) -> Any:
        if name != self._verb:
            return getattr(self._inner, name)
        if name == "angle_deg":
            self._count()
            return getattr(self._inner, name)

        def call(*args: Any) -> Any:
            self._count()
            return getattr(self._inner, name)(*args)

        return call

    def _count(self) -> None:
        self.calls += 1
        if self.calls == self._at or (self.calls > self._at and not self._once):
            raise self._error


def _rig() -> Rig:
    return rigs.of_intensities(seed=3, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=6.3)


ERRORS: tuple[Callable[[], Exception], ...] = (
    lambda: DeviceTimeoutError("no answer"),
    lambda: MoveError("not there"),
    lambda: LaserError("not fired"),
    lambda: AcquisitionError("no frame"),
    lambda: OSError("cable pulled"),
    lambda: RuntimeError("a driver's mistake"),
)


def enumerate_points() -> dict[str, list[str]]:
    """For each verb, what was not a clean stop; the last line of each verb's points is a search that completed."""
    found: dict[str, list[str]] = {}
    for device, verb in VERBS:
        broken: list[str] = []
        reached = 0
        for make in ERRORS:
            for once in (True, False):
                reached = max(reached, _points(device, verb, make, broken, once=once))
        found[f"{device}.{verb} ({reached} points, {len(ERRORS)} errors, once and for good)"] = broken
    return found


def _points(device: str, verb: str, make: Callable[[], Exception], broken: list[str], *, once: bool) -> int:
    for at in range(1, _MAX_CALLS):
        rig = _rig()
        scanner = rig.scanner
        blown = _Blown(getattr(scanner, f"_{device}"), verb, at, make(), once=once)
        setattr(scanner, f"_{device}", blown)
        policy = build(SearchPlan(method="golden-section", acquisitions=6), limits=rig.limits.search)
        events = []
        raised: Exception | None = None
        try:
            for event in run(policy, scanner, RunPlan(dark_frames=2)):
                events.append(event)  # noqa: PERF402  those before an error are wanted too
        except Exception as error:  # noqa: BLE001  whatever comes is what is looked at
            raised = error
        if blown.calls < at:
            if raised is not None or not isinstance(events[-1], Finished):
                broken.append(f"the search does not complete without a fault: {raised}")
            return at - 1
        fault = _unclean(events, raised, scanner.guard.state, harmless=isinstance(blown._error, AcquisitionError))
        if fault is not None:
            broken.append(f"{type(blown._error).__name__} at call {at}: {fault}")
    broken.append("it never completes")
    return _MAX_CALLS


def _unclean(events: list[Any], raised: Exception | None, state: State, *, harmless: bool) -> str | None:
    """Why the end is not clean: reported, no angle after it, and in FAULT unless it was a frame taken again."""
    reported = raised is not None or any(isinstance(event, Refused | Failed) for event in events)
    if not reported:
        return "it was not reported"
    if raised is None:
        return None if harmless and isinstance(events[-1], Finished) else "no error was raised"
    if not isinstance(raised, DeviceError | OSError | RuntimeError):
        return f"it ended with {type(raised).__name__}: {raised}"
    if state is not State.FAULT:
        return f"the guard is {state.value}"
    return None
