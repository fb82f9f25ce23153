"""The way of a frame through the rooms of the package: what returns from one to another, and how often it is imaged.

``python -m benchmarks.frame_way [COMMIT …]`` traces one acquisition of a simulated rig, from the angle to the sample,
for the commits and then for this checkout. A return counts if the caller stands in another package; those of `core`,
whose values and checks all packages share, are counted by themselves. The returns of the frame are those from the
moment when the receiver has it.
"""

from __future__ import annotations

import collections
import os
import subprocess
import sys
import tarfile
import tempfile
from io import BytesIO
from pathlib import Path
from types import FrameType
from typing import NamedTuple

ROOT = Path(__file__).parents[1]

ASKED = """
import sys
sys.path.insert(0, sys.argv[1])
from benchmarks.frame_way import traced
for each in traced():
    print(*each, sep="\\t")
"""


class Return(NamedTuple):
    """A return from one room to another."""

    room: str
    function: str
    to_room: str
    to_function: str


def traced() -> list[Return]:
    """Returns between rooms of one acquisition, in order; the third, because the first two load and compile."""
    import markerseek
    from markerseek import rigs

    package = Path(markerseek.__file__).parent
    rig = rigs.simulated(seed=1)
    for angle_deg in (0.0, 3.0):
        rig.scanner.measure(angle_deg)
    calls: list[tuple[FrameType, str]] = []
    found: list[Return] = []

    def room_of(frame: FrameType) -> str | None:
        path = Path(frame.f_code.co_filename)
        if not path.is_relative_to(package):
            return None
        return ".".join(path.parent.relative_to(package).parts) or path.stem

    def follow(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and (room := room_of(frame)) is not None:
            calls.append((frame, room))
        elif event == "return" and calls and calls[-1][0] is frame:
            _, room = calls.pop()
            if calls and calls[-1][1] != room:
                caller, to_room = calls[-1]
                found.append(Return(room, frame.f_code.co_qualname, to_room, caller.f_code.co_qualname))

    sys.setprofile(follow)
    try:
        rig.scanner.measure(5.0)
    finally:
        sys.setprofile(None)
    return found


def traced_at(commit: str) -> list[Return]:
    """The same of another commit."""
    archive = subprocess.run(["git", "archive", commit, "src"], cwd=ROOT, capture_output=True, check=True).stdout
    with tempfile.TemporaryDirectory() as folder, tarfile.open(fileobj=BytesIO(archive)) as packed:
        packed.extractall(folder, filter="data")
        return traced_in(Path(folder) / "src")


def traced_in(source: Path) -> list[Return]:
    """The same of a folder that holds the package."""
    done = subprocess.run(
        [sys.executable, "-c", ASKED, str(ROOT)],
        env=os.environ | {"PYTHONPATH": str(source)},
        cwd=source,
        capture_output=True,
        text=True,
        check=True,
    )
    return [Return(*line.split("\t")) for line in done.stdout.splitlines()]


def of_frame(returns: list[Return]) -> list[Return]:
    """Those from the moment when the receiver has its frame."""
    received = next(number for number, each in enumerate(returns) if each.function.endswith("Receiver.acquire"))
    return returns[received:]


def rows_of(returns: list[Return]) -> dict[str, int]:
    """What is counted of them."""
    beyond_core = [each for each in returns if each.room != "core"]
    return {
        "returns between rooms": len(returns),
        "of these from core": len(returns) - len(beyond_core),
        "of these of the guard, and to it": sum("guard" in (each.room, each.to_room) for each in returns),
        "the others": sum("guard" not in (each.room, each.to_room) and each.room != "core" for each in returns),
        "of the frame": len(of_frame(returns)),
        "of the frame, without core": sum(each.room != "core" for each in of_frame(returns)),
    }


def main() -> None:
    """Print the rows, and the returns of this checkout."""
    commits = sys.argv[1:]
    ways = {commit: traced_at(commit) for commit in commits} | {"this checkout": traced_in(ROOT / "src")}
    columns = [rows_of(way) for way in ways.values()]
    print("| |", " | ".join(ways), "|\n|---" * 1 + "|---" * len(ways) + "|")
    for name in columns[0]:
        print(f"| {name} |", " | ".join(str(column[name]) for column in columns), "|")
    print()
    for each, count in collections.Counter(ways["this checkout"]).items():
        print(f"{count:3} {each.room}: {each.function} → {each.to_room}: {each.to_function}")


if __name__ == "__main__":
    main()
