"""Numbers in ``.mat`` files of version 7.3, which are HDF5 behind 512 bytes of MATLAB's own.

MATLAB counts along the first axis first and HDF5 along the last, so the axes of each array are reversed. Cells,
structures, texts, logical, sparse and complex arrays are passed over.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import MissingExtraError, RecordError
from markerseek.records.careful.hdf5 import MOST_PER_BYTE, CarefulFile, speaking_of
from markerseek.records.careful.vetting import vet

if TYPE_CHECKING:
    import h5py

HEAD_BYTES = 520
"""As many bytes as `is_mat73` wants to see."""

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_USER_BLOCKS = (0, 512)
_CLASSES = frozenset(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)) | {"double", "single"}


def is_mat73(head: bytes) -> bool:
    """Whether a file that begins like this is HDF5, as version 7.3 writes it or other programs do."""
    return any(head[start : start + len(_SIGNATURE)] == _SIGNATURE for start in _USER_BLOCKS)


def mat73_arrays(path: Path) -> dict[str, np.ndarray]:
    """Real numeric variables of the file by name, their axes as in MATLAB.

    Raises
    ------
    RecordError
        If it is damaged, leads elsewhere, or unpacks to far more than it holds.
    MissingExtraError
        If h5py is not installed.
    """
    try:
        import h5py  # noqa: F401
    except ImportError as problem:
        raise MissingExtraError(package="h5py", extra="records", purpose="a .mat of version 7.3") from problem
    vet(path)
    return unvetted_arrays(path)


def unvetted_arrays(path: Path) -> dict[str, np.ndarray]:
    """The same of a file that is known to do no harm."""
    with _variables(path) as variables:
        return {name: _values(item) for name, item in variables}


def walk_arrays(path: Path) -> None:
    """Go through the places of all variables in the file, of which only the first part is read."""
    with _variables(path) as variables:
        for _, item in variables:
            if item.chunks is not None:
                item.id.chunk_iter(lambda _place: None)
            if 0 not in item.shape:
                _ = item[(0,) * item.ndim]


@contextmanager
def _variables(path: Path) -> Iterator[Iterator[tuple[str, h5py.Dataset]]]:
    """Names and datasets of the numeric variables, while the file is open."""
    import h5py

    size = path.stat().st_size
    with (
        speaking_of(path, what="MATLAB file of version 7.3", cure="it is damaged: fetch or save it again"),
        h5py.File(path, "r") as file,
    ):
        yield _numeric(path, file, CarefulFile(file, size=size), left=MOST_PER_BYTE * size)


def _numeric(path: Path, file: h5py.File, careful: CarefulFile, *, left: int) -> Iterator[tuple[str, h5py.Dataset]]:
    import h5py

    for name in file:
        hard = isinstance(file.get(name, getlink=True), h5py.HardLink)
        if not hard or file.get(name, getclass=True) is not h5py.Dataset or not _is_numeric(file[name]):
            continue
        left -= math.prod(file[name].shape) * file[name].dtype.itemsize
        if left < 0:
            raise RecordError(
                f"{path}: it unpacks to more than {MOST_PER_BYTE} times its size; save it with '-v7.3', "
                "'-nocompression'"
            )
        yield name, careful.dataset(name)


def _is_numeric(item: h5py.Dataset) -> bool:
    """Whether it holds real numbers and, where it says what it was in MATLAB, was an array of such there."""
    kind = item.attrs.get("MATLAB_class", b"double")
    word = kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)
    return word in _CLASSES and item.shape is not None and item.dtype.kind in "iuf" and item.dtype.itemsize <= 8


def _values(item: h5py.Dataset) -> np.ndarray:
    """Values with the axes as in MATLAB; of an empty array HDF5 holds the shape instead."""
    if "MATLAB_empty" in item.attrs:
        return np.empty(0)
    return np.asarray(item[()], dtype=item.dtype.newbyteorder("=")).T
