"""Types of arrays with their shapes, for annotations.

jaxtyping takes a tenth of a second to import, and no annotation is evaluated while a program runs. So the names here
are jaxtyping's for type checkers and wherever jaxtyping was imported before, as in the tests, which check every call;
for all others they stand for any array.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

CHECKED = "jaxtyping" in sys.modules
"""Whether annotations are checked while the program runs: then all names in them must exist."""

if TYPE_CHECKING or CHECKED:
    from jaxtyping import Bool, Complex128, Float32, Float64, Int16, Int32, Int64, UInt8
else:

    class _AnyArray:
        """Array of any type and shape: of what stands in the brackets, the class of the array alone counts."""

        def __class_getitem__(cls, described: tuple[Any, str]) -> Any:
            return described[0]

    class _NumPy:
        """NumPy in annotations, which is imported when the first of them is evaluated: a frame is decoded."""

        @property
        def ndarray(self) -> Any:
            import numpy as np

            return np.ndarray

    Bool = Complex128 = Float32 = Float64 = Int16 = Int32 = Int64 = UInt8 = _AnyArray
    np = _NumPy()

__all__ = ["CHECKED", "Bool", "Complex128", "Float32", "Float64", "Int16", "Int32", "Int64", "UInt8"]
