"""Contents of OpenIGTLink messages as checked values: lengths in millimetres, matrices of 4 x 4 that map AToB."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from markerseek.core import ConfigError, Float64, is_finite, is_whole

MAX_TEXT_BYTES = 0xFFFF
"""Longest text of a STRING, whose length is a 16-bit number; used for a COMMAND too."""

COMMAND_NAME_BYTES, STATUS_NAME_BYTES = 128, 20
"""Longest name of a COMMAND, and of a STATUS."""

EMULATOR = "simulated by markerseek"
"""What an emulated server says of itself in a STATUS, and in the metadata ``emulator`` of its images."""

OK, UNKNOWN_ERROR, BUSY, NOT_READY = 1, 2, 6, 13
"""Codes of a STATUS."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Transform:
    """TRANSFORM: a rigid or affine transform, or None."""

    kind: ClassVar[str] = "TRANSFORM"
    matrix: Float64[np.ndarray, "4 4"] | None
    """4 x 4, the last row (0, 0, 0, 1); None: sent as NaN."""

    def __post_init__(self) -> None:
        if self.matrix is not None:
            _require_matrix(self.kind, self.matrix)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Image:
    """IMAGE with one number per pixel."""

    kind: ClassVar[str] = "IMAGE"
    pixels: np.ndarray
    """Shape (slices, rows, columns): int8, uint8, int16, uint16, int32, uint32, float32 or float64."""
    matrix: Float64[np.ndarray, "4 4"]
    """4 x 4: from (column, row, slice, 1) to the world, in millimetres."""
    system: str = "ras"
    """Axes of the world. 3D Slicer takes RAS, whatever is named here."""

    def __post_init__(self) -> None:
        _require_matrix(self.kind, self.matrix)
        if self.pixels.ndim != 3 or not all(0 < size <= 0xFFFF for size in self.pixels.shape):
            raise ConfigError(
                f"IMAGE: pixels have the shape {self.pixels.shape}, it must be (slices, rows, columns), each from 1 to "
                "65535"
            )
        if self.pixels.dtype.newbyteorder("=") not in SCALARS.values():
            raise ConfigError(f"IMAGE: pixels are {self.pixels.dtype}; convert them to uint8, int16 or float32")
        if self.system not in ("ras", "lps"):
            raise ConfigError(f"IMAGE: system is {self.system!r}, it must be ras or lps")


SCALARS = {
    number: np.dtype(name)
    for number, name in (
        (2, "int8"),
        (3, "uint8"),
        (4, "int16"),
        (5, "uint16"),
        (6, "int32"),
        (7, "uint32"),
        (10, "float32"),
        (11, "float64"),
    )
}
"""Types of pixels by their number in an IMAGE."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One point of a POINT message: its name and group, and where it is, in millimetres."""

    name: str
    group: str
    position_mm: tuple[float, float, float]
    diameter_mm: float = 0.0

    def __post_init__(self) -> None:
        if not all(map(is_finite, (*self.position_mm, self.diameter_mm))):
            raise ConfigError(f"POINT: {self.name!r} is at {self.position_mm} mm; each number must be finite")
        for what, text, most in (("name", self.name, 64), ("group", self.group, 32)):
            _require_bytes(f"POINT: {what}", text, most)


@dataclass(frozen=True, slots=True, kw_only=True)
class Points:
    """POINT: a list of points."""

    kind: ClassVar[str] = "POINT"
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Position:
    """POSITION: a position in millimetres, or None, and an orientation as the quaternion (x, y, z, w)."""

    kind: ClassVar[str] = "POSITION"
    position_mm: tuple[float, float, float] | None
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not all(map(is_finite, (self.position_mm or ()) + self.quaternion)):
            raise ConfigError(f"POSITION: {self.position_mm} mm, {self.quaternion}: each number must be finite")


@dataclass(frozen=True, slots=True, kw_only=True)
class Text:
    """STRING."""

    kind: ClassVar[str] = "STRING"
    text: str

    def __post_init__(self) -> None:
        _require_bytes("STRING: its text", self.text, MAX_TEXT_BYTES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """STATUS: a code of the protocol, a code of one's own, a name, and a sentence."""

    kind: ClassVar[str] = "STATUS"
    code: int
    subcode: int = 0
    name: str = ""
    message: str = ""

    def __post_init__(self) -> None:
        _require_whole("STATUS: code", self.code, 0, 0xFFFF)
        _require_whole("STATUS: subcode", self.subcode, -(1 << 63), (1 << 63) - 1)
        _require_bytes("STATUS: name", self.name, STATUS_NAME_BYTES)
        _require_bytes("STATUS: message", self.message, MAX_TEXT_BYTES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """COMMAND: a request with a number, a name, and its text, usually XML."""

    kind: ClassVar[str] = "COMMAND"
    number: int
    name: str
    text: str

    def __post_init__(self) -> None:
        _require_whole("COMMAND: number", self.number, 0, 0xFFFFFFFF)
        _require_bytes("COMMAND: name", self.name, COMMAND_NAME_BYTES)
        _require_bytes("COMMAND: text", self.text, MAX_TEXT_BYTES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply(Command):
    """RTS_COMMAND: the answer to the COMMAND of the same number."""

    kind: ClassVar[str] = "RTS_COMMAND"


@dataclass(frozen=True, slots=True, kw_only=True)
class Other:
    """A message of another type, whose content is not decoded."""

    kind: str


Content: TypeAlias = Transform | Image | Points | Position | Text | Status | Command | Reply | Other
"""Content of a message."""


def _require_matrix(what: str, matrix: Float64[np.ndarray, "4 4"]) -> None:
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or matrix[3].tolist() != [0, 0, 0, 1]:
        raise ConfigError(
            f"{what}: the matrix is {matrix.tolist()}; it must be 4 x 4, finite, and its last row 0, 0, 0, 1"
        )


def _require_bytes(what: str, text: str, most: int) -> None:
    size = len(text.encode("utf-8", errors="surrogatepass"))
    if size > most:
        raise ConfigError(f"{what} has {size} bytes, it may have {most}; shorten it")


def _require_whole(what: str, value: int, low: int, high: int) -> None:
    if not (is_whole(value) and low <= value <= high):
        raise ConfigError(f"{what} is {value!r}, it must be a whole number from {low} to {high}")
