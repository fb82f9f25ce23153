"""What the page shows of a run, compared with the result of the run itself; its images, and where their pixels are."""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from markerseek import rigs
from markerseek.bridges.outcome import Outcome
from markerseek.bridges.page.run_history import (
    BRIGHT_SIGMAS,
    RunHistory,
    fan_model,
    image_model,
    image_texts,
    is_image_of,
    picture_of,
    pooled_levels,
    probe_text,
)
from markerseek.core import (
    PAPER_RANGE,
    Ambiguous,
    AngleBelief,
    Asked,
    Failed,
    Floor,
    Found,
    Interval,
    Measured,
    MoveError,
    NotFound,
    OtherSource,
    PaImage,
    Refused,
    RigFacts,
    SearchPlan,
    Started,
    Swept,
    Turning,
)
from markerseek.records.journal import Interrupted, Resuming, RunView
from markerseek.runs import new_run, plan_on
from markerseek.runs.journalled import with_beliefs
from markerseek.search import METHODS, build
from markerseek.show import (
    RANGE_DB,
    angle_text,
    answer_name,
    drawn_curve,
    event_line,
    flat_result,
    interval_text,
    numbers_of,
    sigma_text,
    verdict_of,
    with_minus,
)
from markerseek.sim import GaussianCurve, ReceiverSettings, SimulatedSettings
from tests.pictured import pictured_entry

NAMES = [method.name for method in METHODS]


def finished_run(method, *, as_published=False, seed=5, marker_deg=-9.4):
    """Search and events, with the rig's clock at each."""
    rig = rigs.of_intensities(seed=seed, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=marker_deg)
    plan = plan_on(rig, SearchPlan(method=method, as_published=as_published, start_deg=rig.stage.angle_deg))
    search = new_run(rig, plan)
    events = with_beliefs(search.events(), search.policy, plan)
    return search, [(event, rig.scanner.clock.now_s()) for event in events]


def shown(search, events) -> list[RunView]:
    views = [RunView.of(search.configuration)]
    for event, clock_s in events:
        views.append(views[-1].add(event, clock_s=clock_s))
    return views[1:]


def fan_of(view: RunView) -> dict[str, Any]:
    return fan_model(view, drawn_curve(view, reveal=view.phase == "finished"))


def a_view(kind="simulated", **known) -> RunView:
    facts = RigFacts(kind=kind, description="", fingerprint="", search=PAPER_RANGE)
    return RunView(plan=SearchPlan(method="ternary"), facts=facts, **known)


@pytest.mark.parametrize(
    ("method", "as_published"), [(each, False) for each in NAMES] + [(each, True) for each in NAMES[1:]]
)
def test_last_snapshot_is_the_result(method, as_published):
    search, events = finished_run(method, as_published=as_published)
    last = shown(search, events)[-1]
    result = search.result()
    assert (last.phase, answer_name(last.belief.estimate)) == ("finished", result.answer)
    assert last.belief.estimate.mean_deg == result.angle_deg
    assert (last.belief.sigma_deg, last.belief.interval95_deg) == (result.sigma_deg, result.interval95_deg)
    assert (last.acquisitions, last.elapsed_s) == (result.acquisitions, result.elapsed_s)
    assert last.travel_deg == pytest.approx(result.travel_deg, abs=1e-9)
    frames = [event.sample.frame.header.pulses for event, _ in events if isinstance(event, Measured)]
    assert last.pulses == sum(frames) > 0
    # The log names the angle as precisely as the verdict does.
    assert event_line(last).endswith(f": {verdict_of(last).angle}")


@pytest.mark.parametrize("method", NAMES)
def test_the_belief_of_an_event_is_that_of_the_policy_when_it_asked(method):
    search, events = finished_run(method)
    policy = build(search.configuration.plan, limits=search.configuration.facts.search)
    for event, _ in events:
        if isinstance(event, Asked) and event.belief is not None and event.role == "search":
            assert event.belief.estimate == policy.estimate()
        if isinstance(event, Measured) and event.role != "confirmation":
            policy.tell(event.sample)
    assert events[-1][0].belief.estimate == events[-1][0].estimate


def test_density_of_the_posterior():
    search, events = finished_run("posterior")
    beliefs = [each.belief for each in shown(search, events) if each.belief is not None]
    for belief in beliefs:
        assert np.all(np.diff(belief.angles_deg) > 0)
        # A second opinion on probability and mean: the trapezoidal rule over the density as it is drawn.
        assert np.trapezoid(belief.density_per_deg, belief.angles_deg) == pytest.approx(1, abs=0.05)
    mean_deg = np.trapezoid(np.multiply(beliefs[-1].density_per_deg, beliefs[-1].angles_deg), beliefs[-1].angles_deg)
    assert mean_deg == pytest.approx(search.result().angle_deg, abs=0.05)
    assert max(beliefs[-1].density_per_deg) > 20 * max(beliefs[0].density_per_deg)


def test_states_that_end_or_interrupt_a_run():
    search, _ = finished_run("posterior")
    snapshot = RunView.of(search.configuration)
    limits = Interval(low_deg=-35.0, high_deg=35.0)
    said = [
        (Started(start_deg=1.0, limits=limits), "ready", False),
        (Asked(role="search", index=1, angle_deg=-3.0), "moving", False),
        (Refused(angle_deg=-3.0, reason="late"), "refused", False),
        (Interrupted(reason="SIGINT"), "stopped", True),
        (Resuming(by="a person", check_deg=None, fault_reset=False, versions={}), "checking", False),
        (Failed(error=MoveError("it did not arrive")), "fault", True),
    ]
    for event, phase, over in said:
        snapshot = snapshot.add(event, clock_s=1.0)
        assert (snapshot.phase, snapshot.over) == (phase, over)
    assert event_line(snapshot) == "fault: it did not arrive; the laser was told to disarm, and the stage to stop"
    verdict = verdict_of(snapshot, next_step="call somebody")
    assert (verdict.word, verdict.kind, verdict.angle) == ("FAULT", "fault", "")
    # What went wrong by itself, in large letters: what laser and stage did, and what to do next, come below it.
    assert (verdict.problem, verdict.next_step) == ("it did not arrive", "call somebody")
    assert verdict.reason == "the laser was told to disarm, and the stage to stop"
    assert snapshot.refused == 1


def test_published_form_claims_nothing():
    search, events = finished_run("ternary", as_published=True)
    snapshots = shown(search, events)
    result = search.result()
    last = snapshots[-1]
    verdict = verdict_of(last)
    assert (verdict.word, verdict.kind, verdict.turn) == ("NO CLAIM", "nothing", "")
    assert (verdict.angle, verdict.sigma) == (f"{result.angle_deg:.3f}°".replace("-", "−"), "")
    assert not any("FOUND" in verdict_of(each).word or "confirm" in event_line(each) for each in snapshots)
    mark = fan_of(last)["curve"]["marks"][-1]
    assert (mark["role"], mark["text"]) == ("confirmation", "")
    printed = Outcome.of(0, msgspec.json.encode(flat_result(result))).result
    assert (printed.answer, printed.is_claimed) == ("found", False)


def test_probe_is_read_back_last_where_its_move_was_cut_short():
    search, events = finished_run("posterior")
    second = next(
        n
        for n, (event, _) in enumerate(events)
        if isinstance(event, Asked) and (event.role, event.index) == ("search", 2)
    )
    views = shown(search, events[: second + 1])
    said = [probe_text(each) for each in views]
    read_back = with_minus(f"read back: {views[-1].probe_deg:.2f}°")
    assert said[-2:] == [read_back, with_minus(f"expected, on its way to {events[second][0].angle_deg:.2f}°")]
    cut_off = views[-1].cut_off("killed; it coasts", problem="killed")
    assert (cut_off.phase, cut_off.number, cut_off.over) == ("cut off", second + 2, True)
    assert event_line(cut_off) == "killed; it coasts"
    assert probe_text(cut_off) == f"last {read_back}"
    verdict = verdict_of(cut_off)
    assert (verdict.word, verdict.kind, verdict.lead) == ("FAULT", "fault", "so far")
    assert (verdict.problem, verdict.reason) == ("killed", "it coasts")


def test_angle_counts_as_found_only_at_the_end():
    search, events = finished_run("posterior")
    snapshots = shown(search, events)
    start_deg = events[0][0].start_deg
    before = next(each for each in reversed(snapshots) if each.phase == "measured")
    assert (verdict_of(before).word, verdict_of(before).reason) == ("SEARCHING", "so far found")
    assert verdict_of(before).turn == ""
    assert verdict_of(snapshots[0]).angle == "–"
    found = verdict_of(snapshots[-1])
    result = search.result()
    assert (found.word, found.kind, found.lead, found.reason) == ("FOUND", "found", "", "")
    # Another way to two significant digits, and to a mean of as many.
    sigma = np.format_float_positional(result.sigma_deg, precision=2, fractional=False, min_digits=2)
    digits = len(sigma.partition(".")[2])
    assert (found.angle, found.sigma) == (f"−{abs(result.angle_deg):.{digits}f}°", f" ± {sigma}°")
    # The probe has been turned to the marker, which is where it began plus that.
    assert found.turn == f"the probe is on it, turned by −{abs(events[-1][0].confirmation.angle_deg - start_deg):.1f}°"


def test_the_fan_holds_what_a_snapshot_holds():
    search, events = finished_run("posterior")
    snapshot = shown(search, events)[-1]
    fan = fan_of(snapshot)
    assert (fan["probe_deg"], fan["target_deg"]) == (snapshot.probe_deg, None)
    assert fan["curve"]["known"] == {"angle_deg": -9.4, "text": "truth −9.40°"}
    assert fan["text"].startswith(with_minus(f"probe from its end: at {snapshot.probe_deg:.2f}°; marker at −9."))
    numbers = [str(point.number) for point in snapshot.points if point.role == "search"]
    # The confirmation has confirmed the marker.
    assert [mark["text"] for mark in fan["curve"]["marks"]] == [*numbers, "✓"]
    # The answer is known to some hundredths of the range, and at the start not at all.
    first = fan_of(RunView.of(search.configuration))
    assert (first["certainty"], first["choices"]) == (0.0, [])
    assert first["text"] == "probe from its end: nothing is known yet"
    assert fan["certainty"] > 0.5
    weighed = next(view for view in shown(search, events) if view.belief is not None and view.belief.choice_deg)
    shares = dict(fan_of(weighed)["choices"])
    best_deg = min(zip(weighed.belief.choice_sigma_deg, weighed.belief.choice_deg, strict=True))[1]
    assert shares[best_deg] == max(shares.values()) == 1.0


def test_numbers_of_a_run_at_its_end():
    search, events = finished_run("posterior")
    snapshot = shown(search, events)[-1]
    lit, unlit = (dict(numbers_of(snapshot, name="ternary", pulse_j=pulse_j)) for pulse_j in (1e-3, None))
    assert lit["light"] == f"{snapshot.pulses:.3g} mJ"
    assert "light" not in unlit
    assert unlit["time"].endswith(" s with the probe at the marker, on the simulated clock")
    assert unlit["detection threshold"].endswith(f" {snapshot.unit}")


def test_truth_is_hidden_until_the_end():
    search, events = finished_run("posterior")
    *before, last = shown(search, events)
    assert drawn_curve(last, reveal=False).known is None
    assert {fan_of(each)["curve"]["known"] is None for each in before} == {True}
    assert fan_of(last)["curve"]["known"]["angle_deg"] == -9.4


def test_the_image_is_of_the_angle_where_the_probe_is():
    rig = rigs.simulated(seed=1, marker_deg=2.0)
    configuration = new_run(rig, SearchPlan(method="posterior")).configuration
    run = RunHistory(configuration)
    for index, angle_deg in enumerate((2.0, 27.0, 2.0), start=1):
        for event in (
            Asked(role="search", index=index, angle_deg=angle_deg),
            Measured(role="search", index=index, sample=rig.scanner.measure(angle_deg)),
        ):
            run.add(pictured_entry(configuration, event))
    asked, there, back = (each for each in run.views if each.number in {3, 4, 6})
    images = [run.picture(each) for each in (asked, there, back)]
    assert [each.angle_deg for each in images] == pytest.approx([2.0, 27.0, 2.0], abs=0.01)
    # On its way the probe is nowhere that has been imaged.
    assert [is_image_of(*each) for each in zip(images, (asked, there, back), strict=True)] == [False, True, True]
    del run.pictures[6]
    # That of the visit before, and not the newest.
    assert run.picture(back).angle_deg == pytest.approx(2.0, abs=0.01)


FLOOR = Floor(level=120.0, source="dark frames")
OF_ONE = {"interval95_deg": Interval(low_deg=-30.0, high_deg=3.0), "interval_kind": "posterior"}


@pytest.mark.parametrize(
    ("estimate", "angle", "answers_deg", "others_deg"),
    [
        (NotFound(mean_deg=1.7, reason="noise", floor=FLOOR), "", [], []),
        # The standard deviation is of one of its sources, and would be read as that of the last angle.
        (
            Ambiguous(mean_deg=-24.9, modes_deg=(-24.9, 0.8), others=(), surveyed=0.996, sigma_deg=12.0, **OF_ONE),
            "−24.9° or 0.8°",
            [-24.9, 0.8],
            [],
        ),
        (
            Found(
                mean_deg=3.0,
                sigma_deg=0.1,
                interval95_deg=Interval(low_deg=2.8, high_deg=3.2),
                interval_kind="posterior",
                others=(OtherSource(angle_deg=-20.0, sigma_deg=0.5, relative_db=-8.2),),
            ),
            "3.00° ± 0.10°",
            [3.0],
            [-20.0],
        ),
    ],
    ids=("not found", "ambiguous", "found"),
)
def test_only_angles_that_are_claimed_are_named(estimate, angle, answers_deg, others_deg):
    snapshot = a_view(belief=AngleBelief(estimate=estimate))
    assert angle_text(snapshot.belief) + sigma_text(snapshot.belief) == angle
    if isinstance(estimate, Ambiguous):
        verdict = verdict_of(replace(snapshot, phase="finished"))
        assert (verdict.word, verdict.interval) == ("AMBIGUOUS", "")
        assert verdict.reason == "the samples fit a marker at each of −24.90 deg and 0.80 deg"
    curve = drawn_curve(snapshot, reveal=False)
    assert [each.angle_deg for each in curve.answers] == answers_deg
    assert [each.angle_deg for each in curve.others] == others_deg
    rows = dict(numbers_of(snapshot, name="ternary"))
    assert rows["other sources"] == ("−8.2 dB at −20.00°" if estimate.others else "not looked for")
    assert rows.get("range checked") == ("99.6 %, for a second source as strong" if estimate.surveyed else None)


def test_a_sweep_is_drawn_pulse_by_pulse():
    settings = SimulatedSettings(start_deg=-35.0, receiver=ReceiverSettings(readout_s=0.05))
    rig = rigs.of_intensities(seed=3, curve=GaussianCurve(fwhm_deg=5.0), marker_deg=-14.0, settings=settings)
    plan = SearchPlan(method="posterior", start_deg=-35.0, others=0.0, sweep_speed_deg_s=8.6)
    search = new_run(rig, plan_on(rig, plan))
    run = RunHistory(search.configuration)
    events = []
    for event in search.events():
        events.append(event)
        run.add(pictured_entry(search.configuration, event, clock_s=rig.scanner.clock.now_s()))
    swept = next(index for index, event in enumerate(events) if isinstance(event, Swept))
    asked = run.views[2]
    assert (asked.phase, asked.target_deg) == ("moving", PAPER_RANGE.high_deg)
    # Each pulse is where its probe was, and the needle with it; the log keeps the sweep's end only.
    for event, now in zip(events[2:swept], run.views[3 : swept + 1], strict=True):
        assert (now.phase, now.probe_deg, now.target_deg) == ("sweeping", event.sample.angle_deg, None)
        assert probe_text(now).startswith("read back: ")
    ended = run.views[swept + 1]
    assert (ended.phase, ended.probe_deg) == ("measured", events[swept].angle_deg)
    assert len(fan_of(ended)["curve"]["marks"]) == events[swept].pulses
    lines = [line.split("s  ")[1] for line in run.lines(ended, most=5)]
    assert lines == [event_line(ended), event_line(run.views[1])]
    assert f" after {events[swept].pulses} pulses, the probe is at " in event_line(ended)
    assert len(run.lines(run.views[10], most=5)) == 2
    assert run.last.travel_deg == pytest.approx(events[-1].travel_deg)
    assert run.name == "posterior, sweeping"


def found_at(mean_deg, sigma_deg, **given):
    interval = Interval(low_deg=mean_deg - 2 * sigma_deg, high_deg=mean_deg + 2 * sigma_deg)
    usual = {"interval_kind": "posterior"} | given
    return AngleBelief(estimate=Found(mean_deg=mean_deg, sigma_deg=sigma_deg, interval95_deg=interval, **usual))


@pytest.mark.parametrize(
    ("mean_deg", "sigma_deg", "said"),
    [
        (-7.32848, 0.01651, "−7.328° ± 0.017°"),
        (7.32848, 0.0996, "7.33° ± 0.10°"),
        (-0.04, 1.249, "0.0° ± 1.2°"),
        (12.3, 14.2, "12° ± 14°"),
    ],
)
def test_sigma_has_two_significant_digits_and_the_angle_as_many(mean_deg, sigma_deg, said):
    belief = found_at(mean_deg, sigma_deg)
    assert angle_text(belief) + sigma_text(belief) == said


def test_interval_says_what_it_is():
    assert (
        interval_text(found_at(-3.0, 0.1, half_width_m=5e-4))
        == "95 %: −3.20° to −2.80°, ±\N{NO-BREAK SPACE}0.5\N{NO-BREAK SPACE}mm"
    )
    assert interval_text(found_at(3.0, 0.1, interval_kind="bracket")) == "last bracket: 2.80° to 3.20°"


def test_minus_signs_are_those_of_numbers_only():
    assert with_minus("from -3.5 to [-35, 35], 20260101-130000-x-y 1e-3 (-2°)") == (
        "from −3.5 to [−35, 35], 20260101-130000-x-y 1e-3 (−2°)"
    )


def test_a_person_is_asked_on_the_page_to_turn_the_probe():
    search, events = finished_run("ternary")
    run = RunHistory(search.configuration)
    for event, clock_s in events[:-1]:
        run.add(pictured_entry(search.configuration, event, clock_s=clock_s))
        if isinstance(event, Asked) and event.role == "search":
            break
    for angle_deg, says in ((-7.34, "it is at −7.3°"), (None, "type the angle reached")):
        turning = Turning(target_deg=-12.0, angle_deg=angle_deg)
        run.add(pictured_entry(search.configuration, turning, clock_s=1.0))
        assert event_line(run.last) == f"turn the probe to −12.0°: {says}"
        shown = verdict_of(run.last)
        assert (shown.word, shown.lead, shown.angle) == ("TURN", "turn the probe to", "−12.0°")
        # Said once.
        assert shown.reason == says
    refused = Refused(angle_deg=-12.0, reason="too late")
    run.add(pictured_entry(search.configuration, refused, clock_s=2.0))
    assert verdict_of(run.last).word == "SEARCHING"
    assert not any("turn the probe" in line for line in run.lines(run.last, most=20))
    # Nobody is asked for anything by a search that was killed while it waited.
    turning = Turning(target_deg=-12.0, angle_deg=None)
    run.add(pictured_entry(search.configuration, turning, clock_s=3.0))
    run.cut_off("killed", problem="killed")
    verdict = verdict_of(run.last, next_step="Start begins a new search")
    assert (verdict.word, verdict.problem, verdict.next_step) == ("FAULT", "killed", "Start begins a new search")


def test_image_keeps_its_peak_and_noise_looks_like_noise():
    rng = np.random.default_rng(1)
    envelope = rng.rayleigh(1.0, (990, 12)).astype(np.float32)
    envelope[517, 7] = 300.0
    image = PaImage(envelope=envelope, lateral_m=np.linspace(-0.02, 0.02, 12), depth_m=np.linspace(0.004, 0.08, 990))
    levels = pooled_levels(image, brightest=300.0)
    assert levels.shape == (198, 12)
    assert np.unravel_index(levels.argmax(), levels.shape) == (517 // 5, 7)
    assert levels.max() == 255
    # Brute force, pixel by pixel.
    for row, column in ((0, 0), (100, 3), (197, 11)):
        relative = envelope[5 * row : 5 * row + 5, column].max() / 300.0
        expected = 255 * max(0.0, 1 + 20 * np.log10(relative) / RANGE_DB)
        assert levels[row, column] == pytest.approx(expected, abs=0.5)
    assert pooled_levels(image, brightest=BRIGHT_SIGMAS)[:50].max() < 255 * (
        1 + 20 * np.log10(6 / BRIGHT_SIGMAS) / RANGE_DB
    )


def centre_mm(drawn, row, column):
    """Lateral position and depth of a pixel's centre, from the edges between which the browser draws it."""
    (left, right) = drawn["lateral_mm"]
    (top, bottom) = drawn["depth_mm"]
    return (
        left + (right - left) * (column + 0.5) / drawn["columns"],
        top + (bottom - top) * (row + 0.5) / drawn["rows"],
    )


def test_picture_of_a_simulated_frame_has_its_peak_where_the_reading_has_it():
    rig = rigs.simulated(seed=1, marker_deg=2.0)
    sample = rig.scanner.measure(2.0)
    picture = picture_of(sample, rig.imaging.picture(sample.frame))
    levels = np.frombuffer(base64.b64decode(picture.drawn["pixels"]), dtype=np.uint8)
    lateral_mm, depth_mm = centre_mm(picture.drawn, *np.unravel_index(levels.argmax(), (198, 128)))
    # A pixel is 0.43 mm wide and 0.39 mm deep; the reading has found the peak between its pixels.
    assert (lateral_mm, depth_mm) == pytest.approx(picture.peak_mm, abs=0.25)
    for elsewhere, title in (
        (False, f"image of {sample.angle_deg:.2f}°"),
        (True, f"last image: {sample.angle_deg:.2f}°"),
    ):
        assert image_texts(picture, elsewhere=elsewhere) == (title, "photoacoustic, 40 dB; ring: its peak")
    assert image_model(picture, floor=None)["deg"] == sample.angle_deg
    assert image_model(None, floor=None)["pixels"] == ""
    # The largest envelope of noise is no marker.
    below, above = (image_model(picture, floor=share * sample.reading.intensity) for share in (0.9, 1.0))
    assert (below["peak"], above["peak"]) == (picture.peak_mm, None)
