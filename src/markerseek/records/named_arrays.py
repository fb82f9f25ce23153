"""Reads arrays by name from files of NumPy and MATLAB: ``.npy``, ``.npz``, and ``.mat`` of versions 4 to 7.3.

A ``.mat`` of version 7.3 is HDF5 behind 512 bytes of MATLAB's own. MATLAB stores the first axis contiguously and HDF5
the last, so that the axes of each array are reversed. Cells, structures, texts, logical and sparse arrays are left out,
but for those of a Verasonics workspace (`markerseek.records.vantage`); so are texts and objects of an ``.npz``.
"""

from __future__ import annotations

import math
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from markerseek.core import RecordError
from markerseek.files import require_input
from markerseek.records.child import MAX_PER_BYTE, try_files
from markerseek.records.hdf5 import CheckedHdf5, as_record_error, require_h5py, unit_of_dataset
from markerseek.records.vantage import RCV_DATA, is_workspace, vantage_arrays

if TYPE_CHECKING:
    import h5py

ARRAY_SUFFIXES = (".npy", ".npz", ".mat")
"""Suffixes of files that this module reads."""

_LONGEST_HEADER = 10_000
"""Of an ``.npy``, in bytes; NumPy refuses longer ones, once they are read."""

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


def arrays_in(path: Path, *, most_bytes: int) -> dict[str, np.ndarray]:
    """Return the real numeric arrays in a file, by name; the array of an ``.npy`` has none.

    ``most_bytes``: largest file that is read. Raises `OSError` if it cannot be opened.
    """
    try_arrays([path], most_bytes=most_bytes)
    return {".npy": read_npy, ".npz": read_npz, ".mat": read_mat}[path.suffix.lower()](path)


def try_arrays(paths: Iterable[Path], *, most_bytes: int) -> None:
    """Try many files at once that `arrays_in` will read one by one: a child for each would take 0.4 s."""
    found = []
    for path in paths:
        require_input(path, most_bytes=most_bytes)
        if path.suffix.lower() == ".mat":
            found.append(path)
    try_files(read_mat, found)


class NamedArrays(dict[str, np.ndarray]):
    """Arrays by their names, and what a file holds beside them."""

    left_out: tuple[str, ...] = ()
    """Name and kind of each variable that is no array of numbers."""
    units: Mapping[str, str] = MappingProxyType({})
    """Unit of each variable for which the file states one."""


def content(arrays: Mapping[str, np.ndarray]) -> str:
    """Return the first of some arrays in words, for messages: name, type and shape of each; and what was left out."""
    held = (
        ", ".join(f"{name[:40]} {each.dtype} {each.shape}".strip() for name, each in sorted(arrays.items())[:8])
        or "nothing"
    )
    left_out = arrays.left_out if isinstance(arrays, NamedArrays) else ()
    return f"{held}, and what cannot be read: {', '.join(left_out[:8])}" if left_out else held


def read_npy(path: Path) -> dict[str, np.ndarray]:
    """Return the array of an ``.npy``, under an empty name."""
    try:
        array, ends = _npy_array(path)
    # The header is a Python literal; a hostile one raises errors of many kinds in NumPy's parser.
    except Exception as problem:
        # NumPy's own sentence advises to unpickle it, and the parser's names objects of Python.
        pickled = "it holds Python objects, or another format"
        senseless = "its header makes no sense"
        known = {"pickle": pickled, "Python objects": pickled, " object at 0x": senseless}
        reason = next((said for word, said in known.items() if word in str(problem)), problem)
        raise RecordError(f"{path}: it is no .npy, or cut off: {reason}; save it again with numpy.save") from problem
    if ends < path.stat().st_size:
        raise RecordError(f"{path}: there are bytes behind the array; the file is damaged: save it again")
    if not _is_numbers(array):
        raise RecordError(f"{path}: {array.dtype} of shape {array.shape} found, plain numbers expected; convert it")
    return {"": array}


def _npy_array(path: Path) -> tuple[np.ndarray, int]:
    """Return the array, and the byte at which it ends."""
    with path.open("rb") as file:
        head = file.read(12)
    # NumPy reads a header, and takes memory for it, before it looks at its length.
    if head[6:7] > b"\x01" and int.from_bytes(head[8:12], "little") > _LONGEST_HEADER:
        raise ValueError("its header makes no sense")
    # Mapped, so that a shape beyond the file takes no memory; unpickling would run code of the file.
    mapped = np.load(path, mmap_mode="r", allow_pickle=False)
    if not isinstance(mapped, np.memmap):
        mapped.close()
        raise TypeError("it holds several arrays, one is expected; name it .npz")
    return np.array(mapped), mapped.offset + mapped.nbytes


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an ``.npz``."""
    with as_record_error(path, what=".npz", cure="save it again with numpy.savez"):
        with zipfile.ZipFile(path) as archive:
            # A zip bomb declares its true sizes, or zipfile stops at the size that it declares.
            unpacked_bytes = sum(each.file_size for each in archive.infolist())
        _require_small(path, unpacked_bytes, cure="save it with numpy.savez instead of savez_compressed")
        arrays = NamedArrays()
        left_out: list[str] = []
        with np.load(path, allow_pickle=False) as archive:
            for name in archive.files:
                kind = _add(arrays, name, archive)
                left_out += [f"{name} ({kind})"] if kind else []
    arrays.left_out = tuple(left_out)
    return arrays


def _add(arrays: dict[str, np.ndarray], name: str, archive: Mapping[str, object]) -> str:
    """Add a variable of an ``.npz`` if it is an array of numbers, and return the kind of any other."""
    try:
        array = archive[name]
    except ValueError as problem:
        # None, lists and dictionaries are pickled, and unpickling would run code of the file.
        if "allow_pickle" not in str(problem):
            raise
        return "object"
    # A member that is no .npy comes as bytes.
    if not isinstance(array, np.ndarray):
        return "file"
    if not _is_numbers(array):
        return str(array.dtype)
    arrays[name] = array
    return ""


def _require_small(path: Path, unpacked_bytes: int, *, cure: str) -> None:
    if unpacked_bytes > MAX_PER_BYTE * path.stat().st_size:
        raise RecordError(f"{path}: it unpacks to more than {MAX_PER_BYTE} times its size; {cure}")


def _is_numbers(array: np.ndarray) -> bool:
    return array.dtype.kind in "biufc" and array.dtype.itemsize <= 16


def read_mat(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a ``.mat``, in the types that they had in MATLAB: of version 7.3 by h5py, else by SciPy."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if any(head[start:].startswith(_HDF5_SIGNATURE) for start in _HDF5_STARTS):
        require_h5py(purpose="a .mat of version 7.3")
        return read_mat73(path)
    from scipy.io import loadmat, whosmat

    with as_record_error(path, what="MATLAB file", cure="it is cut off or damaged: fetch or save it again"):
        held = whosmat(path, appendmat=False)
        if any(name == RCV_DATA for name, _, _ in held):
            raise RecordError(f"{path}: it is a Verasonics workspace; save it as HDF5: save('run.mat', '-v7.3')")
        found = [each for each in held if each[2] in _MATLAB_TYPES]
        unpacked_bytes = sum(math.prod(shape) * _MATLAB_TYPES[kind].itemsize for _, shape, kind in found)
        _require_small(path, unpacked_bytes, cure="save it with -v6 (uncompressed)")
        names = [name for name, _, _ in found]
        loaded = loadmat(path, appendmat=False, variable_names=names)
        # MATLAB stores small numbers in fewer bytes than their class has. SciPy's mat_dtype would restore the class,
        # but silently drop imaginary parts.
        arrays = NamedArrays(
            (name, loaded[name] if loaded[name].dtype.kind == "c" else loaded[name].astype(_MATLAB_TYPES[kind]))
            for name, _, kind in found
            if name in loaded and loaded[name].dtype.kind in "iufc"
        )
        arrays.left_out = tuple(f"{name} ({kind})" for name, _, kind in held if name not in arrays)
        return arrays


def read_mat73(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a ``.mat`` of version 7.3, read by h5py."""
    with (
        as_record_error(path, what="MATLAB file of version 7.3", cure="it is damaged: fetch or save it again"),
        CheckedHdf5(path) as file,
    ):
        arrays = NamedArrays()
        held = list(file.found(deep=False))
        for name, item in _numeric(path, file, held, cure="save it with '-v7.3', '-nocompression'"):
            arrays[name] = _matlab_values(file, item, name)
        if is_workspace(file):
            return arrays | vantage_arrays(path, file)
        arrays.left_out = tuple(
            f"{name} ({_kind_of(item)})" for name, item in held if name not in arrays and name[0] != "#"
        )
        return arrays


def plain_arrays(path: Path, file: CheckedHdf5) -> dict[str, np.ndarray]:
    """Return the arrays of an HDF5 file that is of no known format.

    Groups are looked into where the top level holds single numbers at most. An array in a group has the last part of
    its name where no other has it, else its whole path.
    """
    cure = "save it without compression"
    held = list(file.found(deep=False))
    # Of a file whose arrays are at the top, groups may hold far more than is needed.
    if all(item.size == 1 for _, item in held if _is_numeric(item)):
        held = list(file.found(deep=True))
    numeric = dict(_numeric(path, file, held, cure=cure))
    short = _short_names(numeric)
    arrays = NamedArrays((short[name], _values(file, item, name)) for name, item in numeric.items())
    arrays.units = {short[name]: unit for name, item in numeric.items() if (unit := unit_of_dataset(item))}
    arrays.left_out = tuple(
        item if isinstance(item, str) else f"{name[:40]} ({getattr(item, 'dtype', 'group')})"
        for name, item in held
        if name not in numeric
    )
    return arrays


def _short_names(paths: Iterable[str]) -> dict[str, str]:
    """Return the last part of each path where no other has it, else the path."""
    last = {path: path.rpartition("/")[2] for path in paths}
    count = Counter(last.values())
    return {path: name if count[name] == 1 or name == path else path for path, name in last.items()}


def _numeric(
    path: Path, file: CheckedHdf5, held: Iterable[tuple[str, h5py.HLObject | str]], *, cure: str
) -> Iterator[tuple[str, h5py.Dataset]]:
    """Yield the datasets that hold numbers, of what a file holds."""
    unpacked_bytes = 0
    for name, item in held:
        if _is_numeric(item):
            # All arrays together, because all of them come back at once.
            unpacked_bytes += math.prod(item.shape) * item.dtype.itemsize
            _require_small(path, unpacked_bytes, cure=cure)
            yield name, file.checked(item, name=name)


def _kind_of(item: h5py.HLObject | str) -> str:
    """Return the kind of a variable that is no array of numbers, as MATLAB calls it."""
    return "link" if isinstance(item, str) else _class_of(item, otherwise="struct")


def _class_of(item: h5py.HLObject, *, otherwise: str) -> str:
    """Return the class that a variable had in MATLAB; ``otherwise``: where the file does not say."""
    kind = item.attrs.get("MATLAB_class", otherwise)
    return kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)


def _is_numeric(item: h5py.HLObject | str) -> TypeGuard[h5py.Dataset]:
    """Return whether something is a dataset of numbers, real or complex, also by the class that it had in MATLAB."""
    import h5py

    if not isinstance(item, h5py.Dataset) or item.shape is None:
        return False
    complex_of_matlab = item.dtype.names == ("real", "imag")
    real = item.dtype.kind in "iuf" and item.dtype.itemsize <= 8
    number = real or complex_of_matlab or (item.dtype.kind == "c" and item.dtype.itemsize <= 16)
    return number and _class_of(item, otherwise="double") in _MATLAB_TYPES


def _matlab_values(file: CheckedHdf5, item: h5py.Dataset, name: str) -> np.ndarray:
    """Return the values with the axes as in MATLAB."""
    # Of an empty array the dataset holds the shape, not values.
    if "MATLAB_empty" in item.attrs:
        return np.empty(0)
    return _values(file, item, name).T


def _values(file: CheckedHdf5, item: h5py.Dataset, name: str) -> np.ndarray:
    """Return the values in the byte order of this machine; a pair of real and imaginary parts is one number."""
    if item.dtype.names == ("real", "imag"):
        pairs = item[()]
        return np.asarray(pairs["real"] + 1j * pairs["imag"])
    return file.values(item, name=name)
