"""What `benchmarks.house` counts, on packages of a few lines."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks import house

CASES: dict[str, tuple[Callable[[house.Checkout], list[str]], dict[str, str], list[str]]] = {
    "an assignment of several values or to several names is packed, one of a function's pair is not": (
        house.packed_assignments,
        {"core/a.py": "x, y = 1, 2\nx, y = pair()\nx = y = 3\n"},
        ["core/a.py:1", "core/a.py:3"],
    ),
    "a message that names an option or a command, but no docstring, no argument, and none of cli": (
        house.option_messages,
        {
            "core/a.py": '"""Read by --json."""\nraise E(f"{x}: add --plot, or {y}")\nrun(["--json"])\n',
            "core/b.py": 'CURE = "make one with markerseek search"\nOTHER = "markerseek reads it -- see there"\n',
            "cli/search.py": 'raise E("add --plot, please")\n',
        },
        ["core/a.py:2", "core/b.py:1"],
    ),
    "a public name that two rooms define": (
        house.names_in_two_rooms,
        {
            "core/a.py": "LEAST = 1\nclass Both: ...\ndef _own(): ...\n",
            "core/b.py": "class Both: ...\n",
            "scan/a.py": "LEAST: int = 2\ndef Both(): ...\ndef _own(): ...\n",
        },
        ["Both", "LEAST"],
    ),
    "classes that are an answer: those of Estimate are one, and means are none": (
        house.answers,
        {
            "core/a.py": "class Common:\n mean_deg: float\n floor: float\n others: int\n surveyed: float\n"
            "class Found(Common):\n sigma_deg: float\n"
            "Estimate: TypeAlias = Found\n",
            "show/b.py": "class Three:\n angle_deg: float\n mean_deg: float\n floor: float\n others: int\n"
            "class Four:\n angle_deg: float\n floor: float\n others: int\n known_s: float\n"
            "class Means:\n acquisitions: Mean\n travel_deg: Mean\n elapsed_s: Mean\n known_s: Mean\n",
        },
        ["Estimate", "show/b.py:Four"],
    ),
    "a function that tells three steps apart is a fold": (
        house.session_folds,
        {
            "core/a.py": "RecordedStep: TypeAlias = A | B | C\n"
            "def two(step):\n match step:\n  case A() | B(): ...\n"
            "def three(step):\n match step:\n  case A(): ...\n  case B() | C(): ...\n",
        },
        ["core/a.py:three"],
    ),
    "a record has check sums and torn tails; a sum that is compared only is of an earlier version": (
        house.record_formats,
        {
            "records/a.py": "line = zlib.crc32(text)\n",
            "records/b.py": "os.ftruncate(descriptor, end)\n",
            "scan/b.py": "whole = prefix == zlib.crc32(text)\nos.ftruncate(descriptor, end)\n",
            "runs/c.py": "block = zlib.crc32(text)\n",
        },
        ["records"],
    ),
    "settings of a session": (
        house.session_settings,
        {
            "core/a.py": "class Plan:\n sweep: bool\n tre_mm: float\n again: bool\n wait_s: float\n"
            "class Goal:\n tre_mm: float\n goal_m: float\n sweep: bool\n again: bool\n"
        },
        ["core/a.py:Plan"],
    ),
    "a curve as a class, as parameters, and as keys": (
        house.drawings,
        {
            "show/a.py": "class Curve:\n marks: int\n density: int\n answer_deg: int\n others: int\n threshold: int\n"
            "def draw(samples, estimate, density, *, limits, truth_deg): ...\n"
            "def short(samples, estimate, density, *, limits): ...\n"
            "def model():\n return {'points': 1, 'mean': 2, 'others': 3, 'interval': 4, 'truth': 5}\n",
        },
        ["show/a.py:Curve", "show/a.py:draw", "show/a.py:model"],
    ),
    "kinds of value, also of those that are reached through a union": (
        house.kinds_of_value,
        {
            "core/a.py": "class S(msgspec.Struct):\n held: Any\n"
            "@dataclass\nclass Plan:\n sweep: bool = option(False)\n"
            "@dataclass\nclass Inner: ...\n"
            "@dataclass\nclass Apart: ...\n"
            "class Below(S): ...\n"
            "Any: TypeAlias = Inner | int\n",
        },
        ["2 Structs (Below, S)", "1 dataclasses with options (Plan)", "1 dataclasses (Inner)"],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_counted(tmp_path: Path, case: str) -> None:
    count, files, expected = CASES[case]
    for name, text in files.items():
        path = tmp_path / "src" / "markerseek" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    assert count(house.Checkout(tmp_path)) == expected


def test_a_cell_names_few_places_and_counts_many(tmp_path: Path) -> None:
    few = house.Row(name="few", most=0, places=lambda _: ["a", "b"])
    many = house.Row(name="many", most=0, places=lambda _: ["a"] * (house.MOST_NAMED + 1))
    none = house.Row(name="none", most=0, places=lambda _: [])
    checkout = house.Checkout(tmp_path)
    assert [row.cell(checkout) for row in (few, many, none)] == ["2: a, b", f"{house.MOST_NAMED + 1}", "0"]


@pytest.mark.parametrize("row", [row for row in house.ROWS if row.kept], ids=lambda row: row.name)
def test_a_goal_that_is_reached_is_kept(row: house.Row) -> None:
    """That each counter sees what it counts is tested above."""
    assert len(row.places(house.Checkout(house.ROOT))) <= row.most
