"""Cameras that read a region of their sensor or join its pixels, and the pixels of points in their images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

SENSOR = (1280, 1024)
MATRIX = np.array([[1090.0, 0, 652.0], [0, 1105.0, 498.0], [0, 0, 1]])
DISTORTION = np.array([-0.3, 0.1, 0.0005, -0.0005, 0.0])
BASE_M = 5.2e-3
TRUS_M = np.array(
    [[-20, -20, 60.8], [20, -20, 58.9], [20, 20, 61.7], [-20, 20, 59.4], [0, 0, 52.1], [8, -15, 67], [-12, 3, 64]]
) * 1e-3  # fmt: skip
# The camera looks at the middle of the points from a distance of 100 mm.
TURN = Rotation.from_euler("xz", [165, 33], degrees=True)
MOVE_M = TRUS_M.mean(axis=0) - TURN.apply([0.002, 0.001, 0.1])


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """What one camera reads of its sensor."""

    first: tuple[int, int] = (0, 0)
    size: tuple[int, int] = (0, 0)
    joined: tuple[int, int] = (0, 0)

    @property
    def image_size(self) -> tuple[int, int]:
        sizes = (self.size[axis] or SENSOR[axis] for axis in range(2))
        width, height = (size // (joined or 1) for size, joined in zip(sizes, self.joined, strict=True))
        return width, height

    def pixels(self, sensor_px: np.ndarray) -> np.ndarray:
        """Pixels of the image: a joined pixel's centre is the mean of those of its pixels."""
        joined = np.maximum(self.joined, 1)
        return (sensor_px - np.array(self.first) + 0.5) / joined - 0.5

    def camera_info(self, shift_m: float, *, printed: bool) -> str:
        """As ROS prints a message, or as a driver saves it."""
        numbers = {"D": DISTORTION, "K": MATRIX.ravel(), "R": np.eye(3).ravel()}
        numbers["P"] = np.column_stack([MATRIX, [MATRIX[0, 0] * shift_m, 0, 0]]).ravel()
        lines = [f"height: {SENSOR[1]}", f"width: {SENSOR[0]}", "distortion_model: plumb_bob"]
        names = {"D": "d", "K": "k", "R": "r", "P": "p"}
        lines += [f"{name if printed else names[name]}: {each.tolist()}" for name, each in numbers.items()]
        lines += [f"binning_x: {self.joined[0]}", f"binning_y: {self.joined[1]}", "roi:"]
        lines += [f"  x_offset: {self.first[0]}", f"  y_offset: {self.first[1]}"]
        lines += [f"  height: {self.size[1]}", f"  width: {self.size[0]}", "  do_rectify: false"]
        return "\n".join(lines) + ("\n---\n" if printed else "\n")


def cameras(folder: Path, left: Part, right: Part, *, printed: bool = True) -> list[object]:
    for name, part, shift_m in (("l", left, 0.0), ("r", right, -BASE_M)):
        (folder / f"{name}.yaml").write_text(part.camera_info(shift_m, printed=printed), encoding="utf-8")
    return ["--cameras", folder / "l.yaml", "--cameras", folder / "r.yaml", "--calibration-sigma-px", 0.2]


def seen(left: Part, right: Part) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of the points in both images, by OpenCV."""
    camera_m = TURN.inv().apply(TRUS_M - MOVE_M)
    return tuple(
        part.pixels(cv2.projectPoints(camera_m, np.zeros(3), np.array([-shift_m, 0, 0]), MATRIX, DISTORTION)[0][:, 0])
        for part, shift_m in ((left, 0.0), (right, BASE_M))
    )


PARTS = {
    "whole": (Part(), Part()),
    "region": (Part(first=(140, 112), size=(1000, 800)),) * 2,
    "issue": (Part(first=(40, 30), size=(1200, 960)),) * 2,
    "different regions": (Part(first=(150, 40), size=(1100, 900)), Part(first=(60, 110), size=(1150, 880))),
    "joined": (Part(joined=(2, 2)),) * 2,
    "joined along rows": (Part(joined=(4, 1)),) * 2,
    "region of joined": (Part(first=(100, 60), size=(1100, 900), joined=(2, 2)),) * 2,
}
