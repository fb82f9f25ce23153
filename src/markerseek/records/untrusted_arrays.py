"""Reads arrays by name from files of NumPy and MATLAB: ``.npy``, ``.npz``, and ``.mat`` of versions 4 to 7.3.

`arrays_in` asks a `Sandbox`; the readers below it run in the sandbox's child. A ``.mat`` of version 7.3 is HDF5 behind
512 bytes of MATLAB's own. MATLAB stores the first axis contiguously and HDF5 the last, so the axes of each array are
reversed. Cells, structures, texts, logical, sparse and complex arrays are left out, but for those of a Verasonics
workspace (`markerseek.records.untrusted_vantage`).
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from markerseek.core import RecordError
from markerseek.files import open_input
from markerseek.records.sandbox import MAX_PER_BYTE, Reader, Sandbox
from markerseek.records.untrusted_hdf5 import UntrustedHdf5, as_record_error, require_h5py
from markerseek.records.untrusted_vantage import FRAMES, is_workspace, vantage_arrays

if TYPE_CHECKING:
    import h5py

ARRAY_SUFFIXES = (".npy", ".npz", ".mat")
"""Suffixes of files that this module reads."""

_HEAD_BYTES = 520
_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
# MATLAB writes 512 bytes of text before the HDF5; other programs write none.
_HDF5_STARTS = (0, 512)
_MATLAB_TYPES: dict[str, np.dtype[Any]] = {
    "double": np.dtype("f8"),
    "single": np.dtype("f4"),
    **{f"{sign}int{bits}": np.dtype(f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)},
}
"""Types of numbers by their class in MATLAB."""


def arrays_in(path: Path, sandbox: Sandbox, *, most_bytes: int) -> dict[str, np.ndarray]:
    """Real numeric arrays in a file, by name; the array of an ``.npy`` has none.

    ``most_bytes``: largest file that is read. Raises `OSError` if it cannot be opened.
    """
    with open_input(path, most_bytes=most_bytes) as file:
        head = file.read(_HEAD_BYTES)
    readers: dict[str, Reader] = {".npy": read_npy, ".npz": read_npz, ".mat": read_mat}
    reader = readers[path.suffix.lower()]
    if reader is read_mat and any(head[start:].startswith(_HDF5_SIGNATURE) for start in _HDF5_STARTS):
        require_h5py(purpose="a .mat of version 7.3")
        reader = read_mat73
    return sandbox.read(reader, path)


def content(arrays: Mapping[str, np.ndarray]) -> str:
    """The first of some arrays in words, for messages: name, type and shape of each."""
    return ", ".join(f"{name[:40]} {each.dtype} {each.shape}" for name, each in sorted(arrays.items())[:8]) or "nothing"


def read_npy(path: Path) -> dict[str, np.ndarray]:
    """The array of an ``.npy``, under an empty name."""
    try:
        with path.open("rb") as file:
            # Unpickling would run code of the file.
            array = np.load(file, allow_pickle=False)
            more = file.read(1)
    # The header is a Python literal; a hostile one raises errors of many kinds in NumPy's parser.
    except Exception as problem:
        # NumPy's own sentence advises to unpickle it, and the parser's names objects of Python.
        known = {"pickle": "it holds Python objects, or another format", " object at 0x": "its header makes no sense"}
        reason = next((said for word, said in known.items() if word in str(problem)), problem)
        raise RecordError(f"{path}: it is no .npy, or cut off: {reason}; save it again with numpy.save") from problem
    if not isinstance(array, np.ndarray):
        raise RecordError(f"{path}: it holds several arrays, one is expected; name it .npz")
    if more:
        raise RecordError(f"{path}: there are bytes behind the array; the file is damaged: save it again")
    _require_numbers(path, array)
    return {"": array}


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an ``.npz``."""
    with as_record_error(path, what=".npz", cure="save it again with numpy.savez"):
        with zipfile.ZipFile(path) as archive:
            # A zip bomb declares its true sizes, or zipfile stops at the size that it declares.
            unpacked_bytes = sum(each.file_size for each in archive.infolist())
        _require_small(path, unpacked_bytes, cure="save it with numpy.savez instead of savez_compressed")
        with np.load(path, allow_pickle=False) as archive:
            arrays = dict(archive.items())
    for array in arrays.values():
        _require_numbers(path, array)
    return arrays


def _require_small(path: Path, unpacked_bytes: int, *, cure: str) -> None:
    if unpacked_bytes > MAX_PER_BYTE * path.stat().st_size:
        raise RecordError(f"{path}: it unpacks to more than {MAX_PER_BYTE} times its size; {cure}")


def _require_numbers(path: Path, array: object) -> None:
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf" or array.dtype.itemsize > 8:
        found = f"{array.dtype} of shape {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
        raise RecordError(f"{path}: {found} found, plain numbers expected; convert it")


def read_mat(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a ``.mat`` of versions 4 to 7, read by SciPy, in the types that they had in MATLAB."""
    from scipy.io import loadmat, whosmat

    with as_record_error(path, what="MATLAB file", cure="it is cut off or damaged: fetch or save it again"):
        held = whosmat(path, appendmat=False)
        if any(name == FRAMES for name, _, _ in held):
            raise RecordError(f"{path}: it is a Verasonics workspace; save it as HDF5: save('run.mat', '-v7.3')")
        found = [each for each in held if each[2] in _MATLAB_TYPES]
        unpacked_bytes = sum(math.prod(shape) * _MATLAB_TYPES[kind].itemsize for _, shape, kind in found)
        _require_small(path, unpacked_bytes, cure="save it with -v6 (uncompressed)")
        names = [name for name, _, _ in found]
        loaded = loadmat(path, appendmat=False, variable_names=names)
        # MATLAB stores small numbers in fewer bytes than their class has. SciPy's mat_dtype would restore the class,
        # but silently drop imaginary parts.
        return {
            name: loaded[name].astype(_MATLAB_TYPES[kind], copy=False)
            for name, _, kind in found
            if name in loaded and loaded[name].dtype.kind in "iuf"
        }


def read_mat73(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a ``.mat`` of version 7.3, read by h5py."""
    with (
        as_record_error(path, what="MATLAB file of version 7.3", cure="it is damaged: fetch or save it again"),
        UntrustedHdf5(path) as file,
    ):
        arrays: dict[str, np.ndarray] = {}
        unpacked_bytes = 0
        for name in file.datasets():
            item = file.opened[name]
            if _is_numeric(item):
                # All arrays together, because all of them come back at once.
                unpacked_bytes += math.prod(item.shape) * item.dtype.itemsize
                _require_small(path, unpacked_bytes, cure="save it with '-v7.3', '-nocompression'")
                arrays[name] = _matlab_values(file.dataset(name))
        return arrays | vantage_arrays(path, file) if is_workspace(file) else arrays


def _is_numeric(item: h5py.Dataset) -> bool:
    """Whether a dataset holds real numbers, also by the class that it had in MATLAB."""
    kind = item.attrs.get("MATLAB_class", b"double")
    word = kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)
    return word in _MATLAB_TYPES and item.shape is not None and item.dtype.kind in "iuf" and item.dtype.itemsize <= 8


def _matlab_values(item: h5py.Dataset) -> np.ndarray:
    """Values with the axes as in MATLAB."""
    # Of an empty array the dataset holds the shape, not values.
    if "MATLAB_empty" in item.attrs:
        return np.empty(0)
    return np.asarray(item[()], dtype=item.dtype.newbyteorder("=")).T
