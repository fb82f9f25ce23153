"""How often one fact stands in the package: the rows of the house that a program can count.

``python -m benchmarks.house [COMMIT …]`` prints each row beside its goal, for the commits and then for this checkout.
What few places state is named; of the rest there is the number.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import subprocess
import sys
import tarfile
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from benchmarks.frame_way import of_frame, traced_in

ROOT = Path(__file__).parents[1]

MOST_NAMED = 8
"""Most places of a row that are named."""

SHARED = 4
"""Fields that two classes must share to state the same thing twice."""


@dataclass(frozen=True, kw_only=True)
class Module:
    """One file of the package."""

    path: Path
    """Path in the package."""
    tree: ast.Module

    @property
    def room(self) -> str:
        """Its package, or the module itself if it stands alone."""
        return ".".join(self.path.parent.parts) or self.path.stem

    @property
    def floor(self) -> str:
        """The package of the top level that it belongs to."""
        return self.path.parts[0].removesuffix(".py")

    @property
    def classes(self) -> Iterator[ast.ClassDef]:
        """All classes, also those in functions and classes."""
        return (node for node in ast.walk(self.tree) if isinstance(node, ast.ClassDef))

    @property
    def functions(self) -> Iterator[ast.FunctionDef]:
        """All functions and methods."""
        return (node for node in ast.walk(self.tree) if isinstance(node, ast.FunctionDef))


@dataclass(frozen=True)
class Checkout:
    """The package at one commit."""

    root: Path
    """Folder that holds ``src``."""

    @cached_property
    def modules(self) -> tuple[Module, ...]:
        """All modules of the package."""
        package = self.root / "src" / "markerseek"
        return tuple(
            Module(path=path.relative_to(package), tree=ast.parse(path.read_text(encoding="utf-8")))
            for path in sorted(package.rglob("*.py"))
        )

    @cached_property
    def below_cli(self) -> tuple[Module, ...]:
        """The modules that no command line belongs to."""
        return tuple(each for each in self.modules if each.floor not in {"cli", "__main__"})

    def class_named(self, name: str) -> ast.ClassDef | None:
        """Return the class of this name; None if there is none."""
        return next((found for module in self.modules for found in module.classes if found.name == name), None)

    def members(self, alias: str) -> set[str]:
        """Return the names in a union of the top level, with those of the unions that it names."""
        found: set[str] = set()
        for module in self.modules:
            for node in module.tree.body:
                if isinstance(node, ast.AnnAssign) and _target(node) == alias and node.value is not None:
                    found |= {each.id for each in ast.walk(node.value) if isinstance(each, ast.Name)}
        return found.union(*(self.members(name) for name in found))


def fields_of(found: ast.ClassDef) -> set[str]:
    """Return the names of the fields that a class states itself, without means over many values."""
    stated = (node for node in found.body if isinstance(node, ast.AnnAssign))
    return {_target(node) for node in stated if getattr(node.annotation, "id", "") != "Mean"} - {""}


def _target(node: ast.AnnAssign) -> str:
    return node.target.id if isinstance(node.target, ast.Name) else ""


def _decorators(found: ast.ClassDef) -> set[str]:
    return {each.id for node in found.decorator_list for each in ast.walk(node) if isinstance(each, ast.Name)}


# --- one value -------------------------------------------------------------------------------------------------------


def kinds_of_value(checkout: Checkout) -> list[str]:
    """Kinds of class that are written or read: Structs, dataclasses with options, other dataclasses in one of these.

    The events of a journal are written too.
    """
    classes = [each for module in checkout.modules for each in module.classes]
    found = {each.name: each for each in classes}
    structs = {each.name for each in classes if "Struct" in _ancestors(each.name, found | {each.name: each})}
    dataclasses = {name for name, each in found.items() if "dataclass" in _decorators(each)}
    optional = {name for name in dataclasses if _has_options(found[name])}
    written = structs | optional | checkout.members("JournalEvent") | checkout.members("Event")
    reached: set[str] = set()
    while written:
        reached |= written
        written = {name for each in written & found.keys() for name in _annotated(found[each], checkout)} - reached
    kinds = {
        "Structs": structs,
        "dataclasses with options": optional,
        # A name that two rooms give to a class of each kind is taken for that of the Struct.
        "dataclasses": (reached & dataclasses) - optional - structs,
    }
    return [
        f"{len(names)} {kind}" + (f" ({', '.join(sorted(names))})" if len(names) <= MOST_NAMED else "")
        for kind, names in kinds.items()
        if names
    ]


def _ancestors(name: str, found: dict[str, ast.ClassDef]) -> set[str]:
    """Return the names of all classes from which a class inherits, the last part of each."""
    if name not in found:
        return set()
    direct = {base.attr if isinstance(base, ast.Attribute) else getattr(base, "id", "") for base in found[name].bases}
    return direct.union(*(_ancestors(each, found) for each in direct - {name}))


def _has_options(found: ast.ClassDef) -> bool:
    values = (node.value for node in found.body if isinstance(node, ast.AnnAssign))
    return any(isinstance(each, ast.Call) and getattr(each.func, "id", "") == "option" for each in values)


def _annotated(found: ast.ClassDef, checkout: Checkout) -> set[str]:
    """Return the names in the annotations of a class's fields, and those of the unions that they name."""
    nodes = [node.annotation for node in found.body if isinstance(node, ast.AnnAssign)]
    names = {each.id for node in nodes for each in ast.walk(node) if isinstance(each, ast.Name)}
    return names.union(*(checkout.members(name) for name in names if name[:1].isupper()))


# --- one fold, one record, one plan ----------------------------------------------------------------------------------


def session_folds(checkout: Checkout) -> list[str]:
    """Functions below `cli` that tell three or more kinds of step of a registration session apart."""
    steps = checkout.members("RecordedStep") or checkout.members("Step")
    return [
        f"{module.path}:{function.name}"
        for module in checkout.below_cli
        for function in module.functions
        if len(_matched(function) & steps) >= 3
    ]


def _matched(function: ast.FunctionDef) -> set[str]:
    """Return the classes among the cases of a function."""
    cases = (node.cls for node in ast.walk(function) if isinstance(node, ast.MatchClass))
    return {each.id for each in cases if isinstance(each, ast.Name)}


def record_formats(checkout: Checkout) -> list[str]:
    """Rooms that write check sums and cut off what was torn; what only compares sums, reads an earlier version's."""
    summing: set[str] = set()
    cutting: set[str] = set()
    for module in checkout.modules:
        compared = {
            id(each) for node in ast.walk(module.tree) if isinstance(node, ast.Compare) for each in ast.walk(node)
        }
        used = [node for node in ast.walk(module.tree) if isinstance(node, ast.Attribute)]
        if any(each.attr == "crc32" and id(each) not in compared for each in used):
            summing.add(module.room)
        if any(each.attr == "ftruncate" for each in used):
            cutting.add(module.room)
    return sorted(summing & cutting)


SESSION_SETTINGS = {
    "sweep": "sweep", "tre_mm": "goal", "goal_m": "goal", "goal_mm": "goal", "markers": "markers", "again": "again",
    "wait_s": "wait", "idle_s": "idle", "light_while_waiting": "light", "no_frames": "frames", "target_mm": "target",
    "target_trus_m": "target", "tolerance_mm": "tolerance", "guided": "guided",
}  # fmt: skip
"""Names of what a person chooses of a registration session."""


def session_settings(checkout: Checkout) -> list[str]:
    """Classes that state four or more settings of a registration session."""
    return _sharing(checkout, SESSION_SETTINGS)


# --- one answer, one curve -------------------------------------------------------------------------------------------

ANSWER_FIELDS = {
    "mean_deg": "angle", "angle_deg": "angle", "sigma_deg": "sigma", "interval95_deg": "interval",
    "low_deg": "interval", "high_deg": "interval", "interval_kind": "kind", "half_width_m": "half width",
    "answer": "name", "reason": "reason", "doubt": "doubt", "floor": "floor", "others": "others",
    "others_deg": "others", "surveyed": "surveyed", "outliers_deg": "outliers", "curve": "curve",
    "other_probability": "other probability",
    "acquisitions": "acquisitions", "refused": "refused", "travel_deg": "travel", "elapsed_s": "elapsed",
    "known_s": "known", "confirmation": "confirmation", "near": "near",
}  # fmt: skip
"""Names of the facts of an answer, and of what it took. A field that is a mean over many searches is none of them."""

CURVE_FIELDS = {
    "marks": "marks", "points": "marks", "samples": "marks", "density": "density", "density_per_deg": "density",
    "answer_deg": "answer", "mean": "answer", "estimate": "answer", "others": "others", "others_deg": "others",
    "interval": "interval", "interval_deg": "interval", "bracket": "bracket", "bracket_deg": "bracket",
    "threshold": "threshold", "floor": "threshold", "known": "known", "truth": "known", "truth_deg": "known",
    "limits": "range", "range_deg": "range", "low": "range",
}  # fmt: skip
"""Names of what a curve of intensities shows."""

CURVE_SHARED = 5
"""As `SHARED`, of a curve: a list of samples with their limits and truth is no drawing yet."""


def answers(checkout: Checkout) -> list[str]:
    """Classes that state four or more facts of an answer; the members of `Estimate`, and their parent, count as one."""
    classes = {each.name: each for module in checkout.modules for each in module.classes}
    members = checkout.members("Estimate")
    estimates = members.union(*(_ancestors(each, classes) for each in members))
    found = _sharing(checkout, ANSWER_FIELDS)
    others = [each for each in found if each.rpartition(":")[2] not in estimates]
    return [*(["Estimate"] if len(others) < len(found) else []), *others]


def drawings(checkout: Checkout) -> list[str]:
    """Models of a curve: classes, dictionaries and parameter lists that name five or more things that it shows."""
    found = _sharing(checkout, CURVE_FIELDS, least=CURVE_SHARED)
    for module in checkout.modules:
        for function in module.functions:
            given = {each.arg for each in (*function.args.args, *function.args.kwonlyargs)}
            keys = {
                key.value
                for node in ast.walk(function)
                if isinstance(node, ast.Dict)
                for key in node.keys
                if isinstance(key, ast.Constant)
            }
            shown = ({CURVE_FIELDS[name] for name in names & CURVE_FIELDS.keys()} for names in (given, keys))
            if any(len(each) >= CURVE_SHARED for each in shown):
                found.append(f"{module.path}:{function.name}")
    return found


def _sharing(checkout: Checkout, meanings: dict[str, str], *, least: int = SHARED) -> list[str]:
    """Return the classes whose own fields have at least so many of these meanings."""
    return [
        f"{module.path}:{found.name}"
        for module in checkout.modules
        for found in module.classes
        if len({meanings[name] for name in fields_of(found) & meanings.keys()}) >= least
    ]


# --- words -----------------------------------------------------------------------------------------------------------


def names_in_two_rooms(checkout: Checkout) -> list[str]:
    """Public names that are defined in two rooms."""
    rooms: dict[str, set[str]] = defaultdict(set)
    for module in checkout.modules:
        for node in module.tree.body:
            for name in _defined(node):
                if not name.startswith("_"):
                    rooms[name].add(module.room)
    return sorted(name for name, where in rooms.items() if len(where) > 1)


def _defined(node: ast.stmt) -> list[str]:
    match node:
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.AnnAssign(target=ast.Name(id=name)):
            return [name]
        case ast.Assign(targets=targets):
            return [each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)]
    return []


FOREIGN = ("--force-reinstall", "--list-devices", "--ros-args", "--frame-id", "--child-frame-id", "--ms-")
"""Begin the options of other programs, and the variables of style sheets."""


def option_messages(checkout: Checkout) -> list[str]:
    """Texts below `cli`, docstrings apart, that name an option or a command, which is a file of `cli`."""
    commands = "|".join(module.path.stem for module in checkout.modules if module.floor == "cli")
    named = re.compile(rf"(?<![\w-])(?!{'|'.join(FOREIGN)})--[a-z]|\bmarkerseek ({commands or '-'})\b")
    return [
        f"{module.path}:{node.lineno}"
        for module in checkout.below_cli
        for node, text in _texts(module.tree)
        # A word alone is an argument of a child process.
        if " " in text and named.search(text)
    ]


def _texts(tree: ast.Module) -> Iterator[tuple[ast.expr, str]]:
    """Yield each text of a module but its docstrings, a formatted one as a whole, with an ellipsis for each value."""
    passed = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts = [part.value if isinstance(part, ast.Constant) else "…" for part in node.values]
            passed |= {id(part) for part in node.values}
            yield node, "".join(map(str, parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in passed:
            yield node, node.value


def packed_assignments(checkout: Checkout) -> list[str]:
    """Lines that assign several values to as many names, or one value to several names."""
    return [
        f"{module.path}:{node.lineno}"
        for module in checkout.modules
        for node in ast.walk(module.tree)
        if isinstance(node, ast.Assign)
        and (
            len(node.targets) > 1
            or (isinstance(node.value, ast.Tuple) and any(isinstance(target, ast.Tuple) for target in node.targets))
        )
    ]


# --- the way in ------------------------------------------------------------------------------------------------------

_SEARCH = """
import sys
from markerseek.cli import main
sys.argv = ["markerseek", "search", "--seed", "1", "--no-journal", "--json"]
try:
    main()
except SystemExit:
    pass
for name, module in sys.modules.items():
    if name.startswith("markerseek."):
        print(module.__file__, file=sys.stderr)
"""


def rooms_of_search(checkout: Checkout) -> list[str]:
    """Rooms of which a simulated search has imported a module at its end."""
    source = checkout.root / "src"
    done = subprocess.run(
        [sys.executable, "-c", _SEARCH],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": str(source), "PATH": "/usr/bin:/bin", "HOME": tempfile.gettempdir()},
    )
    package = source / "markerseek"
    files = {Path(line) for line in done.stderr.splitlines() if line.startswith(str(package))}
    return sorted({module.room for module in checkout.modules if package / module.path in files})


def frame_returns(checkout: Checkout) -> list[str]:
    """Functions that return from one room to another while a frame is read; those of `core` do not count."""
    found = of_frame(traced_in(checkout.root / "src"))
    return [each.function for each in found if each.room != "core"]


def traced_frame_returns(checkout: Checkout) -> list[str]:
    """All of them."""
    return [each.function for each in of_frame(traced_in(checkout.root / "src"))]


@dataclass(frozen=True, kw_only=True)
class Row:
    """One row of the table."""

    name: str
    most: int
    """The goal."""
    places: Callable[[Checkout], Sequence[str]]
    """What is counted."""
    kept: bool = False
    """Whether the goal is reached, and a test keeps it."""

    def cell(self, checkout: Checkout) -> str:
        """Return the count, with the places where there are few."""
        found = self.places(checkout)
        return f"{len(found)}" if not 0 < len(found) <= MOST_NAMED else f"{len(found)}: {', '.join(found)}"


ROWS = (
    Row(name="kinds of value class that are written or read", most=1, places=kinds_of_value),
    Row(name="folds of a registration session", most=1, places=session_folds, kept=True),
    Row(name="record formats with check sums of their own", most=1, places=record_formats, kept=True),
    Row(name="settings of a session stated", most=1, places=session_settings, kept=True),
    Row(name="classes that are an answer", most=4, places=answers, kept=True),
    Row(name="models of one curve", most=1, places=drawings, kept=True),
    Row(name="returns between rooms of a frame, from its receiver to its reading", most=8, places=frame_returns),
    Row(name="the same with those of core", most=25, places=traced_frame_returns, kept=True),
    Row(name="rooms that a search imports", most=20, places=rooms_of_search, kept=True),
    Row(name="public names that stand in two rooms", most=25, places=names_in_two_rooms, kept=True),
    Row(name="messages below cli that name an option or a command", most=0, places=option_messages, kept=True),
    Row(name="assignments packed in one line", most=30, places=packed_assignments, kept=True),
)


def main() -> None:
    """Print the rows of the commits, and of the working tree."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.house", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("commits", nargs="*", metavar="COMMIT", help="commits that are counted before this checkout")
    commits = parser.parse_args().commits
    columns = []
    for commit in commits:
        done = subprocess.run(["git", "archive", commit, "src"], cwd=ROOT, capture_output=True, check=True)
        with tempfile.TemporaryDirectory() as folder, tarfile.open(fileobj=io.BytesIO(done.stdout)) as archive:
            archive.extractall(folder, filter="data")
            checkout = Checkout(Path(folder))
            columns.append([row.cell(checkout) for row in ROWS])
    checkout = Checkout(ROOT)
    columns.append([row.cell(checkout) for row in ROWS])
    print("| | at most |", *(f"{name} |" for name in (*commits, "this checkout")))
    print("|---|---|" + "---|" * len(columns))
    for number, row in enumerate(ROWS):
        print(f"| {row.name} | {row.most} |", *(f"{column[number]} |" for column in columns))


if __name__ == "__main__":
    main()
