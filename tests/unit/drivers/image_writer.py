"""Another program that writes images of two cameras into two folders, as programs in laboratories do.

``python image_writer.py LEFT RIGHT MANNER NUMBER``: writes so many pairs of 160 x 128 pixels, 25 a second. Pair n is
even, of brightness n. Prints the monotonic time at which each pair was complete.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np


def encoded(value: int, suffix: str = ".png") -> bytes:
    """An image file; in colour, and blue is the brightest."""
    image = np.full((128, 160, 3), (value, value // 2, 0), np.uint8)
    return cv2.imencode(suffix, image)[1].tobytes()


def in_two_halves(path: Path, data: bytes) -> None:
    with path.open("wb") as file:
        file.write(data[: len(data) // 2])
        file.flush()
        time.sleep(0.07)
        file.write(data[len(data) // 2 :])


def renamed(path: Path, data: bytes) -> None:
    for temporary in (path.with_name(f".{path.name}"), path.with_suffix(".tmp"), path.with_name(f"tmp-{path.name}")):
        temporary.write_bytes(data[:-20] if temporary.name.startswith("tmp-") else data)
    path.with_suffix(".tmp").replace(path)
    path.with_name(f"tmp-{path.name}").unlink()


def right_late(left: Path, right: Path, value: int) -> None:
    (left / f"left-{value}.png").write_bytes(encoded(value))
    if value >= 10:
        (right / f"right-{value - 9}.png").write_bytes(encoded(value - 9))


def by_time(left: Path, right: Path, value: int) -> None:
    """No number is that of its partner, and the right camera gives half as many."""
    (left / f"{1000 + value}.png").write_bytes(encoded(value))
    if value % 2:
        (right / f"{5000 + value}.jpg").write_bytes(encoded(value, ".jpg"))


def apart(left: Path, right: Path, value: int) -> None:
    """150 ms after the newest of the other side, with another number: never a pair."""
    time.sleep(0.15)
    ((left, right)[value % 2] / f"{1000 * (value % 2) + value}.png").write_bytes(encoded(value))
    time.sleep(0.15)


def alike(write_one: Callable[[Path, int], None]) -> Callable[[Path, Path, int], None]:
    def write(left: Path, right: Path, value: int) -> None:
        write_one(left, value)
        write_one(right, value)

    return write


MANNERS = {
    "in halves": alike(lambda folder, value: in_two_halves(folder / f"{value:04d}.png", encoded(value))),
    "renamed": alike(lambda folder, value: renamed(folder / f"frame_{value}.png", encoded(value))),
    # Over the files of before.
    "restarting": alike(lambda folder, value: (folder / f"{value % 7}.bmp").write_bytes(encoded(value, ".bmp"))),
    "right late": right_late,
    "by time": by_time,
    "apart": apart,
}

if __name__ == "__main__":
    for count in range(1, int(sys.argv[4]) + 1):
        MANNERS[sys.argv[3]](Path(sys.argv[1]), Path(sys.argv[2]), count)
        sys.stdout.write(f"{time.monotonic()}\n")
        sys.stdout.flush()
        time.sleep(0.04)
