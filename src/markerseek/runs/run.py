"""A run: one search from plan to result, new or resumed, for `search`, `replay` and `resume`."""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass, field

from msgspec.structs import replace

from markerseek.core import (
    AnyPolicy,
    ConfigError,
    Estimate,
    Finished,
    FollowedTissue,
    Measured,
    Policy,
    SearchPlan,
)
from markerseek.records.journal import Configuration, Journal, JournalEvent, RecordedRun, RunView
from markerseek.rigs import Rig
from markerseek.runs.journalled import configuration_of, journalled, limits_of, with_beliefs
from markerseek.runs.own_method import name_of, own_errors, own_method, require_own, require_policy
from markerseek.runs.rebuild import rebuild_policy
from markerseek.runs.resume import resumed
from markerseek.scan import run
from markerseek.search import (
    MethodName,
    build_sweeping,
    is_own_method,
    method_named,
    most_acquisitions,
    of_all_angles,
    posterior_of_all,
    require_plan,
)
from markerseek.show import SearchResult, event_line


@dataclass(slots=True, kw_only=True)
class Run:
    """A search on a rig. Iterate over `events`, then ask for `result`."""

    policy: AnyPolicy
    rig: Rig
    configuration: Configuration
    """Plan of the search and facts of the rig, as a journal holds them."""
    journal: Journal | None = None
    recorded: RecordedRun | None = None
    """Recorded run to be resumed; None for a new run."""
    by: str = ""
    reset_fault: bool = False
    """``by`` and ``reset_fault``: for a resumed run: who arms the rig, and whether that person has inspected it after a
    fault."""
    tissue: FollowedTissue | None = None
    """The tissue, where cameras follow it: samples of a new run state its displacement."""
    view: RunView = field(init=False)
    """The run so far."""

    def __post_init__(self) -> None:
        self.view = RunView.of(self.configuration if self.recorded is None else self.recorded)

    def events(self) -> Generator[JournalEvent, None, None]:
        """Run the search; if closed early, the stage stops and the laser is disarmed.

        Yields as `markerseek.scan.run`, each committed to the journal before. A resumed run yields `Resuming` and
        `Checked` first; its earlier events are in the view. Raises `RecordError` if an event cannot be written; the
        rig is stopped.
        """
        # Closed here, because a generator that is only dropped stops the rig whenever it is collected.
        with closing(self._run()) as events, own_errors(self.configuration.plan.method):
            for event in events:
                # That of the rig may begin anew when a run is resumed; that of the journal goes on.
                clock_s = self.rig.scanner.clock.now_s() if self.journal is None else self.journal.clock_s
                self.view = self.view.add(event, clock_s=clock_s)
                yield event

    def _run(self) -> Generator[JournalEvent, None, None]:
        if self.journal is None:
            return self._unrecorded()
        if self.recorded is None:
            return journalled(
                self.policy, self.rig, self.journal, limits=limits_of(self.configuration), tissue=self.tissue
            )
        return resumed(
            self.policy,
            self.rig,
            self.journal,
            self.recorded,
            by=self.by,
            anew=self._begin_anew,
            reset_fault=self.reset_fault,
        )

    def _unrecorded(self) -> Generator[JournalEvent, None, None]:
        plan = self.configuration.plan
        # Closed with this one, so that the rig is stopped.
        run_events = run(self.policy, self.rig.scanner, plan, limits=limits_of(self.configuration), tissue=self.tissue)
        with closing(run_events) as events:
            # What is believed on the way is for those who follow a record.
            yield from with_beliefs(events, self.policy, plan, of=(Finished,))

    def _begin_anew(self) -> AnyPolicy:
        self.policy = rebuild_policy(self.configuration)
        return self.policy

    def interrupt(self, reason: str) -> None:
        """`Journal.interrupt`, where a journal is kept."""
        if self.journal is not None:
            self.journal.interrupt(reason)

    @property
    def most_acquisitions(self) -> int | None:
        """Most acquisitions of the search, for a progress bar; None if they cannot be counted before."""
        return most_acquisitions(self.configuration.plan)

    def result(self) -> SearchResult:
        """Return the result of the search once it is over; `SearchError` before, and after an error."""
        return SearchResult.of(self.view, notes=self.rig.notes)


def plan_on(rig: Rig, plan: SearchPlan) -> SearchPlan:
    """Return the plan with what follows from the rig.

    The paper's form of a method and a search by sweeps take no dark frames before the search. Every other method, after
    its search of a recording, takes the angles that are left, and answers from all of them.

    Raises `ConfigError` if a recording holds fewer angles than the method needs.
    """
    run_plan = rig.run_plan
    speed_deg_s = plan.sweep_speed_deg_s
    if plan.sweep and speed_deg_s is None:
        speed_deg_s = rig.scanner.sweeping.stage.fastest_sweep_deg_s
    sweeps = speed_deg_s is not None
    # The paper's methods measure no detection threshold, and that of a single pulse is not that of an average.
    without = plan.as_published or sweeps
    in_bursts = sweeps and rig.scanner.sweeping.in_bursts
    acquisitions = plan.acquisitions
    if acquisitions is None and rig.angles_deg is not None and not is_own_method(plan.method):
        method = method_named(plan.method)
        recorded = len(rig.angles_deg)
        if recorded < method.least:
            raise ConfigError(
                f"method: {method.name} needs at least {method.least} acquisitions, and the recording holds {recorded} "
                "angles; choose another, such as posterior"
            )
        acquisitions = min(method.acquisitions, recorded)
    return replace(
        plan,
        acquisitions=acquisitions,
        dark_frames=0 if without else run_plan.dark_frames,
        # Each burst ends with a dark frame, and the number of its triggers is its own.
        closing_dark=run_plan.closing_dark and not in_bursts,
        start_deg=rig.scanner.angle_deg if plan.start_deg is None else plan.start_deg,
        sweep_speed_deg_s=speed_deg_s,
        sweep_from_end=in_bursts,
        stay=plan.stay or run_plan.stay,
        angles_deg=rig.angles_deg,
        whole=rig.angles_deg is not None and not without,
        by_hand=rig.by_hand,
        motion_mm=rig.facts.motion_mm if plan.motion_mm is None else plan.motion_mm,
    )


def require_possible(plan: SearchPlan) -> None:
    """Refuse a plan that no method can carry out, before devices are opened; a method of the user's own is imported."""
    if is_own_method(plan.method):
        require_own(plan)
        own_method(plan.method).number(plan)
    else:
        require_plan(plan)


def find_marker(
    rig: Rig,
    method: SearchPlan | MethodName = "posterior",
    *,
    policy: Policy | None = None,
    progress: bool = False,
) -> SearchResult:
    """Search for the marker on a rig, and return what was found; no record is kept.

    Of a recording, the answer is from all its angles; what a search of it would have taken and said is in the field
    ``search`` of the result.

    Parameters
    ----------
    rig
        A rig; one of real devices must have been armed (`Rig.arm`).
    method
        Name of the method, from where the probe is and with all defaults; or a whole `markerseek.core.SearchPlan`,
        as ``SearchPlan(method="posterior", acquisitions=12)``. The name may be ``module:Class``, a method of your own.
    policy
        A policy of your own that has taken no sample yet, instead of a method.
    progress
        Whether each acquisition is written to standard error when it has been made.

    Raises
    ------
    MarkerseekError
        If the plan cannot be carried out on this rig, or the search ends with a fault.

    Examples
    --------
    >>> import markerseek
    >>> result = markerseek.find_marker(markerseek.simulated(seed=1))
    >>> result.answer
    'found'
    """
    if not isinstance(rig, Rig):
        raise ConfigError(
            f"rig is {rig!r}, it must be a rig, such as markerseek.replayed(path) or markerseek.simulated(seed=1)"
        )
    asked = SearchPlan(method=method) if isinstance(method, str) else method
    if policy is not None:
        if asked != SearchPlan():
            raise ConfigError(f"method is {asked.method}, and a policy is given too; leave one of them out")
        asked = replace(asked, method=name_of(require_policy(policy, name="policy")))
    search = new_run(rig, plan_on(rig, asked), policy=policy)
    for event in search.events():
        if progress and isinstance(event, Measured) and not event.sample.dark:
            sys.stderr.write(f"{event_line(search.view)}\n")
    return search.result()


def new_run(rig: Rig, plan: SearchPlan, *, policy: Policy | None = None, tissue: FollowedTissue | None = None) -> Run:
    """Return a new search, without a journal yet; nothing moves before `Run.events` is iterated.

    ``policy``: one of the user's own; None: that of the plan. ``tissue``: the tissue, where cameras follow it.
    """
    limits = rig.limits.search
    asked: AnyPolicy
    if not is_own_method(plan.method):
        asked = build_sweeping(plan, limits=limits)
    else:
        if policy is None:
            require_own(plan)
            own = own_method(plan.method)
            plan = replace(plan, acquisitions=own.number(plan))
            policy = own.policy(limits=limits, acquisitions=own.number(plan))
        asked = of_all_angles(policy, plan, limits=limits)
    return Run(policy=asked, rig=rig, configuration=configuration_of(rig, plan), tissue=tissue)


def resumed_run(rig: Rig, journal: Journal, recorded: RecordedRun, *, by: str, reset_fault: bool) -> Run:
    """Return a search that is resumed; nothing moves before `Run.events` is iterated.

    ``rig``: rig of the journal, from `markerseek.runs.rebuild_rig`.
    """
    return Run(
        policy=rebuild_policy(recorded.configuration),
        rig=rig,
        configuration=recorded.configuration,
        journal=journal,
        recorded=recorded,
        by=by,
        reset_fault=reset_fault,
    )


def answer_from_all(rig: Rig, plan: SearchPlan) -> Estimate:
    """Return the answer from every angle of a recording, without a search.

    ``rig``: a replayed rig that has measured nothing yet, not interpolated. ``plan``: that of a search of the
    recording, by any method.
    """
    if rig.angles_deg is None:
        raise ConfigError(f"rig is {rig}, it must be a recording that is not interpolated")
    policy = posterior_of_all(replace(plan, angles_deg=rig.angles_deg), limits=rig.limits.search)
    dark = [rig.scanner.measure_dark() for _ in range(rig.dark_frames)]
    # Without their frames: one has half a megabyte.
    policy.tell_recorded([*dark, *(replace(rig.scanner.measure(each), frame=None) for each in rig.angles_deg)])
    return policy.estimate()
