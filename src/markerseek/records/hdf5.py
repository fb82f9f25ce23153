"""Reads HDF5 files with checks: no links to other files, no unusual filters, no huge allocations.

The library itself follows links to other files, loads filter plugins, and allocates what a header declares. Damaged
bytes can also make it crash or hang, so that `markerseek.records.child` tries a file first.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from markerseek._closing import Closing
from markerseek.core import Float64, RecordError, described, needs_package
from markerseek.files import natural
from markerseek.records.child import MAX_PER_BYTE

if TYPE_CHECKING:
    import h5py

_FILTERS = frozenset({1, 2, 3, 32000})
"""Numbers of gzip, shuffle, Fletcher-32 and lzf; any other would make the library load a plugin, that is, run code from
a search path."""

_MAX_TEXT = 10_000


def require_h5py(*, purpose: str = "a bank in HDF5") -> None:
    """Refuse to continue without h5py, and name the extra to install."""
    with needs_package("h5py", extra="records", purpose=purpose):
        import h5py  # noqa: F401


class CheckedHdf5(Closing):
    """An HDF5 file opened for reading, whose methods return harmless parts only.

    A context manager that closes it; garbage collection closes it too.
    """

    def __init__(self, path: Path) -> None:
        import h5py

        self._path = path
        self._most = MAX_PER_BYTE * path.stat().st_size
        try:
            self.opened: h5py.File = h5py.File(path, "r")
        except OSError as problem:
            # A lock of HDF5's own has no error of its own.
            if "unable to lock file" not in str(problem):
                raise
            raise RecordError(
                f"{path}: another program has it open for writing, and holds a lock; close it there, or copy the file"
            ) from problem

    def close(self) -> None:
        """Close the file; allowed twice."""
        self.opened.close()

    def datasets(self) -> list[str]:
        """Names of the datasets at the top level of the file."""
        import h5py

        # Link types are asked for first: opening a soft or external link would already follow it.
        within = filter(self.is_within, self.opened)
        return [name for name in within if self.opened.get(name, getclass=True) is h5py.Dataset]

    def is_within(self, name: str) -> bool:
        """Whether a name at the top level is no link to another place."""
        import h5py

        return isinstance(self.opened.get(name, getlink=True), h5py.HardLink)

    def has(self, name: str) -> bool:
        """Whether the name exists; `TypeError` where it is a link to another place."""
        return self.inside(self.opened, name) is not None

    def names(self, name: str) -> list[str]:
        """Names in a group in natural order, of the whole file for an empty name; empty if it is no group."""
        import h5py

        item = self.inside(self.opened, name) if name else self.opened
        return sorted(item, key=natural) if isinstance(item, h5py.Group) else []

    def dataset(self, name: str) -> h5py.Dataset:
        """Dataset of that name, which fits into memory.

        Raises `TypeError` or `ValueError` if it is missing, is a link to another file, or needs much more memory than
        the file has bytes.
        """
        item = self.inside(self.opened, name)
        if item is None:
            raise ValueError(f"{name} is missing")
        return self.checked(item, name=name)

    def referred(self, reference: h5py.Reference, *, name: str) -> h5py.Dataset:
        """Dataset that a reference points to, with the errors of `dataset`."""
        if not reference:
            raise ValueError(f"{name} refers to nothing")
        return self.checked(self.opened[reference], name=name)

    def scalars(self, references: Iterable[h5py.Reference], *, name: str) -> Float64[np.ndarray, " references"] | None:
        """The single numbers that many references point to; None if one of them points to more.

        Read by the low-level interface of h5py, which takes a tenth of the time. Raises `ValueError` or `TypeError`.
        """
        import h5py

        values = []
        for reference in references:
            item = h5py.h5r.dereference(reference, self.opened.id) if reference else None
            if not isinstance(item, h5py.h5d.DatasetID):
                raise TypeError(f"{name} refers to nothing, or to no dataset")
            plan = item.get_create_plist()
            # In one piece within the file: nothing is unpacked, and no other file is read.
            whole = plan.get_layout() in (h5py.h5d.COMPACT, h5py.h5d.CONTIGUOUS) and not plan.get_external_count()
            if not whole or item.get_space().get_simple_extent_npoints() != 1:
                return None
            value = np.empty(1)
            item.read(h5py.h5s.ALL, h5py.h5s.ALL, value)
            values.append(value[0])
        return np.array(values)

    def checked(self, item: object, *, name: str) -> h5py.Dataset:
        """The item, if it is a dataset as `dataset` returns it."""
        import h5py

        if not isinstance(item, h5py.Dataset):
            raise TypeError(f"{name} is no dataset")
        # Virtual and external datasets read other files, without any link.
        if item.is_virtual or item.external:
            raise ValueError(f"{name} lies in another file")
        plan = item.id.get_create_plist()
        if not {plan.get_filter(number)[0] for number in range(plan.get_nfilters())} <= _FILTERS:
            raise ValueError(f"{name} is compressed by a filter other than gzip and lzf")
        # The library unpacks a whole chunk for a single number of it.
        size = max(math.prod(item.shape or ()), math.prod(item.chunks or ())) * item.dtype.itemsize
        if size > self._most:
            raise ValueError(f"{name} unpacks to {size} bytes, more than {MAX_PER_BYTE} times the file")
        return item

    def numbers(self, name: str) -> Float64[np.ndarray, " values"]:
        """All numbers of a dataset, flattened."""
        item = self.dataset(name)
        if item.dtype.kind not in "iuf" or item.dtype.itemsize > 8:
            raise ValueError(f"{name} is {item.dtype}, numbers are expected")
        return np.atleast_1d(np.asarray(item[()], dtype=np.float64)).ravel()

    def number(self, name: str) -> float | None:
        """The single number of a dataset; None if it is missing, not finite, or the text ``None``."""
        if not self.has(name) or self.text(name) == "None":
            return None
        values = self.numbers(name)
        if values.size != 1:
            raise ValueError(f"{name} holds {values.size} numbers, one is expected")
        return float(values[0]) if math.isfinite(values[0]) else None

    def text(self, name: str) -> str | None:
        """The text of a dataset; None if it is missing or is not text."""
        import h5py

        if not self.has(name):
            return None
        item = self.dataset(name)
        kind = h5py.check_string_dtype(item.dtype)
        # A longer text would be read in full before it could be cut.
        if kind is None or item.shape != () or (kind.length or 0) > _MAX_TEXT:
            return None
        raw = item[()]
        text = raw.decode("utf-8") if isinstance(raw, bytes) else str(raw)
        return text[:_MAX_TEXT]

    def inside(self, group: object, name: str) -> object:
        """Group or dataset of that name in a group; None if it is missing, `TypeError` where it is a link."""
        import h5py

        item = group
        for part in name.split("/"):
            # Part by part, because a path given to h5py follows links in its middle.
            if not isinstance(item, h5py.Group) or part not in item:
                return None
            if not isinstance(item.get(part, getlink=True), h5py.HardLink):
                raise TypeError(f"{part} is a link to another place")
            item = item[part]
        return item


@contextmanager
def as_record_error(path: Path, *, what: str, cure: str) -> Iterator[None]:
    """Turn any error of the library into a `RecordError`; damaged bytes raise errors of many kinds.

    ``cure``: advice at the end of the message.
    """
    try:
        yield
    except RecordError:
        raise
    except ImportError as problem:
        raise RecordError(f"{path}: it cannot be read, because of a library: {described(problem)}") from problem
    except Exception as problem:
        reason = " ".join(str(problem).split()).strip("'\"") or type(problem).__name__
        raise RecordError(f"{path}: no {what} that can be read: {reason}; {cure}") from problem
