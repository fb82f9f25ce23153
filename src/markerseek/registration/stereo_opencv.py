"""Reads the YAML, XML and JSON of ``cv2.FileStorage`` with a stereo calibration, by the names that programs give it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import ConfigError, Float64, needs_package

if TYPE_CHECKING:
    import cv2

SUFFIXES = frozenset({".yml", ".yaml", ".xml", ".json"})
"""Suffixes of these files."""

NAMES: dict[str, tuple[str, ...]] = {
    "left camera matrix": ("M1", "K1", "cameraMatrix1", "camera_matrix_1", "camera_matrix_left", "cameraMatrixL"),
    "left distortion": ("D1", "distCoeffs1", "dist_coeffs_1", "dist_coeffs_left", "distCoeffsL", "D_left"),
    "right camera matrix": (
        "M2", "K2", "cameraMatrix2", "camera_matrix_2", "camera_matrix_right", "cameraMatrixR",
    ),
    "right distortion": ("D2", "distCoeffs2", "dist_coeffs_2", "dist_coeffs_right", "distCoeffsR", "D_right"),
    "rotation": ("R", "rotation", "R_stereo"),
    "translation": ("T", "translation", "T_stereo"),
    "size of the images": ("imageSize", "image_size", "size", "image_width", "imageWidth", "width"),
    "height of the images": ("image_height", "imageHeight", "height"),
}  # fmt: skip
"""What is read, and its names: of OpenCV's ``stereo_calib``, of its documentation, and of what people write."""


def is_of_opencv(path: Path, text: str) -> bool:
    """Whether a text is that of ``cv2.FileStorage``; YAML may be of ROS."""
    return path.suffix.lower() in {".xml", ".json"} or "opencv-matrix" in text or text.startswith("%YAML:1.0")


def read_opencv(paths: Sequence[Path], texts: Sequence[str]) -> dict[str, Float64[np.ndarray, " numbers"]]:
    """Numbers by their names of `NAMES`, from one file or from several that have a part each; row by row.

    Raises `ConfigError` if a file cannot be read.
    """
    with needs_package("opencv-python-headless", extra="vision", purpose=f"{paths[0]}: it", module="cv2"):
        import cv2
    found: dict[str, Float64[np.ndarray, " numbers"]] = {}
    for path, text in zip(paths, texts, strict=True):
        others: list[str] = []
        try:
            storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            for what, names in NAMES.items():
                nodes = [node for node in map(storage.getNode, names) if not node.empty()]
                if not nodes:
                    continue
                numbers = np.array(_numbers(nodes[0]), dtype=np.float64)
                if not np.array_equal(numbers, found.setdefault(what, numbers), equal_nan=True):
                    others.append(what)
        # OpenCV's own error comes wrapped in others.
        except (cv2.error, SystemError, TypeError, ValueError, RecursionError) as problem:
            raise ConfigError(f"{path}: OpenCV cannot read it; save the calibration again") from problem
        if others:
            raise ConfigError(
                f"{path}: the {others[0]} differs from that of {paths[0]}; name the files of one calibration only"
            )
    return found


def numbers_of(found: dict[str, Float64[np.ndarray, " numbers"]], what: str, *counts: int) -> list[float]:
    """The numbers of one name; `ConfigError` if they are missing, or their count is another."""
    names = ", ".join(NAMES[what])
    if what not in found:
        raise ConfigError(f"the {what} is missing; it is read as one of: {names}")
    numbers = found[what]
    if numbers.size not in counts or not np.isfinite(numbers).all():
        many = " or ".join(map(str, counts))
        raise ConfigError(f"the {what} ({names}) holds {numbers.size} numbers, {many} finite ones are expected")
    values: list[float] = numbers.tolist()
    return values


def _numbers(node: cv2.FileNode) -> list[float]:
    """The numbers of a matrix, or of lists of lists."""
    if node.isSeq():
        return [number for index in range(node.size()) for number in _numbers(node.at(index))]
    if node.isMap():
        return [float(number) for number in np.ravel(node.mat())]
    return [float(node.real())]
