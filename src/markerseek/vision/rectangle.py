"""A rectangle of whole pixels in an image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

from markerseek.core import ConfigError, Within, require_fields

LARGEST_PX = 8192
"""Most rows or columns of an image."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rectangle:
    """Part of an image, in whole pixels."""

    row: Annotated[int, Within(-LARGEST_PX, LARGEST_PX, "pixels")]
    column: Annotated[int, Within(-LARGEST_PX, LARGEST_PX, "pixels")]
    """``row`` and ``column``: its upper left pixel."""
    rows: Annotated[int, Within(3, LARGEST_PX, "pixels")]
    columns: Annotated[int, Within(3, LARGEST_PX, "pixels")]

    def __post_init__(self) -> None:
        require_fields(self, "rectangle")

    def centred(self, row: float, column: float) -> Rectangle:
        """The same size, with its middle at a pixel."""
        return replace(self, row=round(row - (self.rows - 1) / 2), column=round(column - (self.columns - 1) / 2))

    def grown(self, rows: int, columns: int, *, shape: tuple[int, int]) -> Rectangle:
        """Larger by these numbers of pixels on each side, as far as the image reaches."""
        row, column = max(0, self.row - rows), max(0, self.column - columns)
        return Rectangle(
            row=row,
            column=column,
            rows=min(shape[0], self.row + self.rows + rows) - row,
            columns=min(shape[1], self.column + self.columns + columns) - column,
        )

    def within(self, shape: tuple[int, int]) -> Rectangle:
        """The part of it inside of an image; `ConfigError` if less than 3 pixels are left."""
        row, column = max(0, self.row), max(0, self.column)
        rows = min(shape[0], self.row + self.rows) - row
        columns = min(shape[1], self.column + self.columns) - column
        if rows < 3 or columns < 3:
            raise ConfigError(
                f"rectangle of {self.rows} × {self.columns} pixels at row {self.row}, column {self.column}: it lies "
                f"outside of the image of {shape[0]} × {shape[1]} pixels; name another"
            )
        return Rectangle(row=row, column=column, rows=rows, columns=columns)

    def relative_to(self, other: Rectangle) -> Rectangle:
        """The same part of the image, counted from the upper left pixel of another rectangle."""
        return replace(self, row=self.row - other.row, column=self.column - other.column)

    @property
    def slices(self) -> tuple[slice, slice]:
        """Index of its pixels in an image that contains it."""
        return slice(self.row, self.row + self.rows), slice(self.column, self.column + self.columns)
