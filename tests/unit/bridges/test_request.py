"""A search that is asked for: a link holds all of it, and what a search would refuse is refused at once."""

from __future__ import annotations

from urllib.parse import parse_qsl

import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.bridges import OPTIONS, SearchRequest
from markerseek.bridges.request import SessionRequest
from markerseek.core import AnglePrior, ConfigError, SimulationOptions
from markerseek.registration import SessionPlan
from markerseek.rigs import simulated
from markerseek.search import METHODS
from markerseek.sim import TISSUES, SimulatedSettings, with_options

USUAL = SearchRequest().changed(seed=1, pace=0.05)

searches = st.fixed_dictionaries(
    {
        "method": st.sampled_from([each.name for each in METHODS]),
        "acquisitions": st.none() | st.integers(20, 200),
        "tolerance_mm": st.floats(0.1, 5.0),
        "near": st.none()
        | st.fixed_dictionaries({"mean_deg": st.floats(-30.0, 30.0), "sigma_deg": st.floats(0.1, 9.0)}),
        "stay": st.booleans(),
        "tissue": st.none() | st.sampled_from(list(TISSUES)),
        "snr_db": st.none() | st.integers(-20, 100).map(float),
        "readout_s": st.none() | st.sampled_from([0.0, 0.1, 10.0]),
        "marker_deg": st.none() | st.floats(-35.0, 35.0),
        "seed": st.integers(0, 2**63 - 1),
        "pace": st.floats(0.0, 100.0),
    }
)


def asked(values) -> SearchRequest:
    near = AnglePrior(**values["near"]) if values["near"] and values["method"] == "posterior" else None
    return USUAL.changed(**values | {"near": near})


@given(searches)
def test_link_holds_all_settings(values):
    chosen = asked(values)
    assert USUAL.with_query(dict(parse_qsl(chosen.query(usual=USUAL)))) == (chosen, ())


@given(searches)
def test_the_command_line_reads_the_arguments_as_they_were_meant(values):
    chosen = asked(values)
    given = dict(each.lstrip("-").partition("=")[::2] for each in chosen.arguments())
    read = {name.replace("-", "_"): OPTIONS[name.replace("-", "_")].read(text or "1") for name, text in given.items()}
    assert SearchRequest().changed(**read) == chosen


def test_all_that_is_wrong_with_a_link_is_named():
    query = {"as_published": "1", "seed": "-5", "rig": "x", "method": "ternary", "snr_db": "much"}
    settings, problems = USUAL.with_query(query)
    # The order in the link does not matter: "as published" is possible with ternary.
    assert settings == USUAL.changed(method="ternary", as_published=True)
    assert [each.split()[0] for each in problems] == ["'rig'", "seed", "snr_db"]


def test_arguments_are_those_of_the_command():
    chosen = USUAL.changed(method="ternary", acquisitions=16, as_published=True, tissue="liver", seed=3, pace=0.0)
    method = ["--method=ternary", "--acquisitions=16", "--as-published"]
    assert chosen.arguments() == [*method, "--seed=3", "--tissue=liver"]
    # A rig of devices has no seed, tissue or pace.
    assert chosen.arguments(simulated=False) == method


sessions = st.fixed_dictionaries(
    {
        "tre_mm": st.none() | st.floats(0.01, 20.0),
        "markers": st.none() | st.integers(3, 12),
        "sweep": st.booleans(),
        "again": st.booleans(),
        "wait_s": st.floats(1.0, 3600.0),
        "tissue": st.none() | st.sampled_from(list(TISSUES)),
        "seed": st.none() | st.integers(0, 2**63 - 1),
        "pace": st.floats(0.0, 100.0),
    }
)


@given(sessions)
def test_link_and_command_line_hold_all_settings_of_a_session(values):
    usual = SessionRequest(plan=SessionPlan(sweep=True))
    chosen = usual.changed(**values)
    assert usual.with_query(dict(parse_qsl(chosen.query(usual=usual)))) == (chosen, ())
    simulate, *given = chosen.arguments()
    assert simulate == "--simulate"
    words = dict(each.lstrip("-").partition("=")[::2] for each in given)
    names = {name.replace("-", "_"): text for name, text in words.items()}
    read = {name: chosen.options[name].read(text or "1") for name, text in names.items()}
    assert SessionRequest().changed(**read) == chosen
    devices = chosen.arguments(simulated=False)
    assert not any(each.startswith(("--simulate", "--seed", "--tissue", "--pace")) for each in devices)


def test_a_session_has_a_target_that_link_and_command_line_hold():
    usual = SessionRequest()
    chosen = usual.changed(target_mm="-5, 0 40.5", seed=3)
    assert chosen.plan.target_trus_m == pytest.approx((-5e-3, 0.0, 40.5e-3))
    assert usual.with_query(dict(parse_qsl(chosen.query(usual=usual)))) == (chosen, ())
    assert chosen.arguments() == ["--simulate", "--seed=3", "--target-mm", "-5", "0", "40.5"]
    assert chosen.changed(target_mm=" ").plan.target_trus_m is None
    assert chosen.changed(seed=4).plan.target_trus_m == chosen.plan.target_trus_m


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("target_mm", "1 2"),
        ("target_mm", "a b c"),
        ("target_mm", "1 2 nan"),
        ("tre_mm", "0"),
        ("tre_mm", "nan"),
        ("markers", "2"),
        ("markers", "3.5"),
        ("wait_s", "-1"),
    ],
)
def test_a_link_with_a_setting_that_no_session_has_is_named(name, value):
    usual = SessionRequest()
    settings, (problem,) = usual.with_query({name: value})
    assert settings == usual
    assert problem.replace("`", "").startswith(f"{name} is ")


def test_change_is_checked():
    assert USUAL.changed(seed=5).simulation.seed == 5
    with pytest.raises(ConfigError, match="seed is"):
        USUAL.changed(seed=-1)


def test_simulated_rig_has_the_noise_and_the_receiver_that_were_asked_for():
    usual = SimulatedSettings()
    assert with_options(usual, SimulationOptions()) == usual
    changed = with_options(usual, SimulationOptions(tissue="liver", snr_db=30.0, readout_s=0.1))
    assert (changed.tissue, changed.noise.peak_snr_db, changed.receiver.readout_s) == ("liver", 30.0, 0.1)
    noisy = with_options(usual, SimulationOptions(snr_db=20.0))
    rigs = [simulated(seed=1, settings=each, marker_deg=0.0) for each in (usual, noisy)]
    readings = [each.scanner.measure(0.0).reading for each in rigs]
    # The gain differs, because marker and noise must fit into the converter; 20 dB less is a tenth of the ratio.
    ratios = [each.intensity / each.noise_sigma for each in readings]
    assert ratios[0] / ratios[1] == pytest.approx(10, rel=0.2)
