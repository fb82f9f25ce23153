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
from markerseek.files import DEGREES, natural
from markerseek.records.child import MAX_PER_BYTE

if TYPE_CHECKING:
    import h5py

_FILTERS = frozenset({1, 2, 3, 32000})
"""Numbers of gzip, shuffle, Fletcher-32 and lzf; any other would make the library load a plugin, that is, run code from
a search path."""

_MAX_TEXT = 10_000

_MOST_LINKS = 16
_MOST_OBJECTS = 1000
"""Most links that lead from one to the next, and most datasets and groups that are looked at where no name is known."""

_NEUTRAL = {
    **dict.fromkeys(("scale", "scaling_factor", "scalefactor", "slope", "conversion"), 1.0),
    **dict.fromkeys(("offset", "intercept"), 0.0),
}
"""Attributes, other than those of the CF conventions, by which a program may want numbers changed, and the value that
changes nothing."""

_UNITS = ("units", "unit")
_SI = frozenset(
    {
        "-", "1", "none", "unitless", "dimensionless", "a.u.", "au", "counts", "adc",
        "hz", "hertz", "1/s", "s", "sec", "second", "seconds", "m", "metre", "metres", "meter", "meters",
        "m/s", "m s-1", "meters/second", "metres/second", "j", "joule", "joules", "v", "volt", "volts",
        "rad", "radian", "radians", *DEGREES,
    }
)  # fmt: skip
"""Units without a prefix, in lower case: numbers whose names need none are in these."""


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

    def found(self, *, deep: bool) -> Iterator[tuple[str, h5py.HLObject | str]]:
        """Yield the datasets and groups by their names, each once, those that are nearest to the top first.

        For what cannot be opened, the reason in place of it. ``deep``: whether groups are looked into.
        """
        import h5py

        seen: set[int] = set()
        waiting: list[tuple[str, h5py.Group]] = [("", self.opened)]
        for prefix, group in waiting:
            for name in sorted(group, key=natural):
                try:
                    item = self.inside(group, name)
                except (TypeError, ValueError, RecordError) as problem:
                    yield prefix + name, str(problem).removeprefix(f"{self._path}: ")
                    continue
                if item is None or (address := h5py.h5o.get_info(item.id).addr) in seen:
                    continue
                seen.add(address)
                if len(seen) > _MOST_OBJECTS:
                    return
                yield prefix + name, item
                if deep and isinstance(item, h5py.Group):
                    waiting.append((f"{prefix}{name}/", item))

    def has(self, name: str) -> bool:
        """Return whether the name exists; `TypeError` where it leads to another file."""
        return self.inside(self.opened, name) is not None

    def names(self, name: str) -> list[str]:
        """Return the names in a group in natural order, of the whole file for an empty name.

        Empty if it is no group.
        """
        import h5py

        item = self.inside(self.opened, name) if name else self.opened
        return sorted(item, key=natural) if isinstance(item, h5py.Group) else []

    def dataset(self, name: str) -> h5py.Dataset:
        """Return the dataset of that name, which fits into memory.

        Raises `TypeError` or `ValueError` if it is missing, is a link to another file, or needs much more memory than
        the file has bytes.
        """
        item = self.inside(self.opened, name)
        if item is None:
            raise ValueError(f"{name} is missing")
        return self.checked(item, name=name)

    def referred(self, reference: h5py.Reference, *, name: str) -> h5py.Dataset:
        """Return the dataset that a reference points to, with the errors of `dataset`."""
        if not reference:
            raise ValueError(f"{name} refers to nothing")
        import h5py

        identifier = h5py.h5r.dereference(reference, self.opened.id)
        if isinstance(identifier, h5py.h5d.DatasetID):
            self._require_here(identifier, name=name)
        return self.checked(self.opened[reference], name=name)

    def scalars(self, references: Iterable[h5py.Reference], *, name: str) -> Float64[np.ndarray, " references"] | None:
        """Return the single numbers that many references point to; None if one of them points to more.

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
        """Return the item, if it is a dataset as `dataset` returns it."""
        import h5py

        if not isinstance(item, h5py.Dataset):
            raise TypeError(f"{name} is no dataset")
        self._require_here(item.id, name=name)
        plan = item.id.get_create_plist()
        if not {plan.get_filter(number)[0] for number in range(plan.get_nfilters())} <= _FILTERS:
            raise ValueError(f"{name} is compressed by a filter other than gzip and lzf")
        # The library unpacks a whole chunk for a single number of it.
        size = max(math.prod(item.shape or ()), math.prod(item.chunks or ())) * item.dtype.itemsize
        if size > self._most:
            raise ValueError(f"{name} unpacks to {size} bytes, more than {MAX_PER_BYTE} times the file")
        return item

    def numbers(self, name: str, *, units: frozenset[str] = _SI) -> Float64[np.ndarray, " values"]:
        """Return all numbers of a dataset, flattened; refused if it states a unit other than ``units``."""
        item = self.dataset(name)
        if item.dtype.kind not in "iuf" or item.dtype.itemsize > 8:
            raise ValueError(f"{name} is {item.dtype}, numbers are expected")
        unit = unit_of_dataset(item)
        if unit and unit.lower() not in units:
            raise RecordError(
                f"{self._path}: {name} has the unit {unit!r}, "
                f"{'degrees' if units is DEGREES else 'a unit without a prefix (Hz, s, m)'} is expected; convert the "
                "numbers, and correct the attribute"
            )
        return np.atleast_1d(np.asarray(self.values(item, name=name), dtype=np.float64)).ravel()

    def values(self, item: h5py.Dataset, *, name: str) -> np.ndarray:
        """Return all values of a dataset, unpacked as its attributes say (``scale_factor`` … of the CF conventions).

        Values that mark missing ones become NaN. Raises `RecordError` if another attribute would change the numbers.
        """
        factor = self._attribute(item, "scale_factor", name=name)
        offset = self._attribute(item, "add_offset", name=name)
        missing = [self._attribute(item, each, name=name) for each in ("_FillValue", "missing_value")]
        unsigned = _text_attribute(item, "_Unsigned").lower()
        if unsigned == "true" and item.dtype.kind == "i":
            raise RecordError(f"{self._path}: {name} has the attribute _Unsigned; save it in an unsigned type")
        for other in sorted(set(item.attrs) & {*_NEUTRAL, *(each.capitalize() for each in _NEUTRAL)}):
            stated = self._attribute(item, other, name=name)
            if stated != _NEUTRAL[other.lower()]:
                raise RecordError(
                    f"{self._path}: {name} has the attribute {other} = {stated:g}, and what it does to the numbers is "
                    "not known; apply it, and take it out (scale_factor and add_offset are read)"
                )
        values = np.asarray(item[()], dtype=item.dtype.newbyteorder("="))
        if item.dtype.kind not in "iuf":
            return values
        marked = np.isin(values, [each for each in missing if each is not None])
        if factor in (None, 1) and offset in (None, 0) and not marked.any():
            return values
        unpacked = values * (1.0 if factor is None else factor) + (0.0 if offset is None else offset)
        return np.where(marked, np.nan, unpacked)

    def _attribute(self, item: h5py.Dataset, attribute: str, *, name: str) -> float | None:
        """Return the one number of an attribute; None if it is missing."""
        if attribute not in item.attrs:
            return None
        held = item.attrs.get_id(attribute)
        if math.prod(held.shape) != 1 or held.dtype.kind not in "iuf":
            raise RecordError(
                f"{self._path}: the attribute {attribute} of {name} is {held.dtype} of shape {held.shape}, one number "
                "is expected; apply it to the numbers, and take it out"
            )
        return float(np.ravel(item.attrs[attribute])[0])

    def _require_here(self, item: h5py.h5d.DatasetID, *, name: str) -> None:
        """Refuse a dataset whose numbers lie in other files, which are read without any link."""
        if _lies_elsewhere(item):
            raise RecordError(
                f"{self._path}: {name} is a virtual or external dataset, whose numbers lie in other files; copy the "
                "numbers into one file"
            )

    def number(self, name: str) -> float | None:
        """Return the single number of a dataset; None if it is missing, not finite, or the text ``None``."""
        if not self.has(name) or self.text(name) == "None":
            return None
        values = self.numbers(name)
        if values.size != 1:
            raise ValueError(f"{name} holds {values.size} numbers, one is expected")
        return float(values[0]) if math.isfinite(values[0]) else None

    def text(self, name: str) -> str | None:
        """Return the text of a dataset; None if it is missing or is not text."""
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

    def inside(self, group: object, name: str, *, links: int = _MOST_LINKS) -> h5py.HLObject | None:
        """Group or dataset of that name in a group; None if it is missing.

        Soft links are followed within the file. Raises `TypeError` where a link leads to another file, or in a circle
        (``links``: most that are followed), `RecordError` where a dataset does.
        """
        import h5py

        item = group
        for part in filter(None, name.split("/")):
            # Part by part, because a path given to h5py follows links in its middle.
            if not isinstance(item, h5py.Group) or (link := item.get(part, getlink=True)) is None:
                return None
            if isinstance(link, h5py.SoftLink):
                if links == 0:
                    raise TypeError(f"{part} is one of more than {_MOST_LINKS} links in a row")
                start = self.opened if link.path.startswith("/") else item
                item = self.inside(start, link.path, links=links - 1)
            elif isinstance(link, h5py.HardLink):
                item = self._opened(item, part)
            else:
                raise TypeError(f"{part} is a link to another place")
        return item

    def _opened(self, group: h5py.Group, name: str) -> h5py.HLObject:
        """Return what a hard link leads to.

        An object of h5py's own keeps the plan of a virtual dataset open, on which HDF5 2.0 crashes when Python ends: no
        such object is made of one.
        """
        import h5py

        identifier = h5py.h5o.open(group.id, name.encode())
        if isinstance(identifier, h5py.h5d.DatasetID):
            self._require_here(identifier, name=name)
        return group[name]


def _lies_elsewhere(item: h5py.h5d.DatasetID) -> bool:
    """Return whether the numbers of a dataset lie in other files."""
    import h5py

    plan = item.get_create_plist()
    return bool(plan.get_layout() == h5py.h5d.VIRTUAL or plan.get_external_count())


def unit_of_dataset(item: h5py.Dataset) -> str:
    """Return the unit that the attributes of a dataset state; empty if they state none."""
    return next(filter(None, (_text_attribute(item, name) for name in _UNITS)), "")


def _text_attribute(item: h5py.Dataset, name: str) -> str:
    """Return the text of an attribute, also of one in capitals; empty if it is missing or no short text."""
    import h5py

    found = next((each for each in (name, name.capitalize(), name.upper()) if each in item.attrs), None)
    if found is None:
        return ""
    held = item.attrs.get_id(found)
    kind = h5py.check_string_dtype(held.dtype)
    if kind is None or math.prod(held.shape) != 1 or (kind.length or 0) > _MAX_TEXT:
        return ""
    value = np.ravel(item.attrs[found])[0]
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return text.strip()[:_MAX_TEXT]


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
