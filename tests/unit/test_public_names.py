"""The public names of the package: few, and all importable."""

from __future__ import annotations

import importlib
import math
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from typing import get_args

import jaxtyping
import numpy as np
import pytest

import benchmarks
import markerseek
from markerseek.core import ConfigError, Interval, shapes
from markerseek.search import METHODS, MethodName

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("name", [each.name for each in pkgutil.walk_packages(benchmarks.__path__, "benchmarks.")])
def test_each_measurement_can_be_imported(name: str) -> None:
    if not name.endswith("__main__"):
        importlib.import_module(name)


def test_the_public_names_are_these() -> None:
    assert sorted(markerseek.__all__) == [
        "Ambiguous",
        "AtBound",
        "Finished",
        "Found",
        "Interval",
        "MarkerseekError",
        "Measured",
        "NotFound",
        "Policy",
        "Reading",
        "RunPlan",
        "Sample",
        "SearchPlan",
        "Unsure",
        "__version__",
        "bank_figure",
        "build",
        "find_marker",
        "replayed",
        "run",
        "search_figure",
        "simulated",
    ]
    for name in markerseek.__all__:
        assert getattr(markerseek, name) is not None


def test_all_names_are_listed_before_they_are_used() -> None:
    program = "import markerseek, sys; print(set(markerseek.__all__) <= set(dir(markerseek)), 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "True False\n"
    with pytest.raises(AttributeError, match="simulate"):
        markerseek.simulate  # noqa: B018


def test_a_range_is_any_two_numbers() -> None:
    for limits in ((-35, 35), [-35.0, 35.0], (np.float32(-35), np.int64(35)), Interval(low_deg=-35.0, high_deg=35.0)):
        policy = markerseek.build(
            markerseek.SearchPlan(method="ternary", acquisitions=16, start_deg=2),
            limits=limits,
        )
        assert (
            policy.ask()
            == markerseek.build(markerseek.SearchPlan(method="ternary", acquisitions=16, start_deg=2)).ask()
        )
    for limits in ((1, 2, 3), (), (35, -35), (math.nan, 1)):
        with pytest.raises(ConfigError, match=r"limits is|interval \["):
            markerseek.build("ternary", limits=limits)


def test_rigs_take_names_of_files_and_numbers_of_all_kinds(tmp_path: Path) -> None:
    rig = EXAMPLES / "rigs" / "simulated.toml"
    first = markerseek.simulated(seed=np.int64(3), settings=str(rig))
    second = markerseek.simulated(seed=3, settings=rig)
    assert first.facts == second.facts
    assert first.facts.truth_deg == 12.5
    turned = markerseek.simulated(seed=3, marker_deg=np.float32(7.5), pace=0)
    assert type(turned.facts.truth_deg) is float
    scan = EXAMPLES / "simulated_scan.csv"
    played = markerseek.replayed(str(scan), reference_deg=np.float64(-8.25))
    assert played.facts.fingerprint == markerseek.replayed(scan, reference_deg=-8).facts.fingerprint
    with pytest.raises(ConfigError, match="its kind is bench"):
        markerseek.simulated(seed=1, settings=EXAMPLES / "rigs" / "bench.toml")


@pytest.mark.parametrize("seed", [-1, 2**63, 1.5, "1", True, None, np.int64(-1), math.nan])
def test_what_is_no_seed_is_refused(seed: object) -> None:
    with pytest.raises(ConfigError, match=r"it must be a whole number from 0 to 2\*\*63 - 1"):
        markerseek.simulated(seed=seed)  # type: ignore[arg-type]


REFUSED = {
    **dict.fromkeys(
        (f"build('ternary', limits={limits})" for limits in ("35", "'ab'", "('x', 'y')", "None", "(True, None)")),
        r"ConfigError: .*(limits is|interval \[)",
    ),
    "Reading(intensity=float('nan'))": r"ReadingError: intensity is nan, it must be a finite number of at least 0",
    "Reading(intensity=float('inf'))": "ReadingError: intensity is inf",
    "Reading(intensity=-1)": "ReadingError: intensity is -1",
    "Reading(intensity='3')": "ReadingError: intensity is '3'",
    "Reading(intensity=None)": "ReadingError: intensity is None",
    "Reading(intensity=1, lateral_m='2')": "ReadingError: lateral_m is '2', it must be a finite number, or None",
    "Reading(intensity=1, noise_sigma=float('nan'))": "ReadingError: noise_sigma is nan",
}
"""Calls with what is no range and no measurement, and what is said of each."""

PROGRAM = """
import sys
from markerseek import Reading, build
for call in sys.argv[1:]:
    try:
        print("taken:", eval(call))
    except Exception as error:
        print(f"{type(error).__name__}: {error}".replace("\\n", " "))
"""


@pytest.fixture(scope="module")
def answers() -> dict[str, str]:
    """From a program of its own, without the type check of the tests, which would refuse them first."""
    done = subprocess.run([sys.executable, "-c", PROGRAM, *REFUSED], capture_output=True, text=True, check=True)
    return dict(zip(REFUSED, done.stdout.splitlines(), strict=True))


@pytest.mark.parametrize("call", REFUSED)
def test_what_is_no_range_or_no_measurement_is_refused(call: str, answers: dict[str, str]) -> None:
    assert re.match(REFUSED[call], answers[call])


def test_shapes_are_those_of_jaxtyping_in_tests_and_cost_nothing_elsewhere() -> None:
    assert shapes.Float64 is jaxtyping.Float64
    program = (
        "import sys; from markerseek.core import shapes; "
        "print(shapes.CHECKED, 'numpy' in sys.modules, shapes.Float64[shapes.np.ndarray, '2 3'])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "False False <class 'numpy.ndarray'>\n"


def test_an_editor_knows_the_names_of_all_methods() -> None:
    assert get_args(MethodName) == tuple(method.name for method in METHODS)


def test_a_simulated_rig_takes_what_the_command_line_takes() -> None:
    rig = markerseek.simulated(4, snr_db=30, tissue="muscle", marker_deg=2, second_marker_deg=-9, readout_s=0.05)
    assert "peak SNR 30 dB, seed 4, a second marker at -9.00 deg" in rig.facts.description
    assert rig.facts.truth_deg == 2
    assert markerseek.simulated(4, no_marker=True).facts.truth_deg is None
    with pytest.raises(ConfigError, match="contradicts"):
        markerseek.simulated(4, no_marker=True, marker_deg=2)
