"""Reads the photoacoustic frames of a Verasonics Vantage workspace: ``RcvData``, ``Receive``, ``Trans`` in a ``.mat``.

The file is HDF5: MATLAB (``-v7.3``) stores cells, and the fields of an
array of structures, as references to datasets; Octave (``-hdf5``) stores each value as a group of ``type`` and
``value``. References are followed once, to numbers or a text, so that one that leads in a circle is refused.

Photoacoustic are the receives without a transmit: of the events with ``tx = 0``, and of those whose ``TX`` has an
apodization of zeros. Where the workspace has no ``Event``, all receives are.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from markerseek.core import Float64, Int16, Int64, RecordError
from markerseek.files import natural
from markerseek.records.hdf5 import CheckedHdf5

if TYPE_CHECKING:
    import h5py

RCV_DATA = "RcvData"
"""The variable by which a workspace is known."""

NUMBERS = "buffer frame"
LAST = "last buffer frame"
"""Names of the arrays with the number in the buffer of each frame, from 1, and of the last one, where it is stated."""

MAX_ITEMS = 5000
"""Most receives, events or frames that are read; more would take minutes."""

_THICKEST_LENS = 100
"""Of the lens of a probe, in wavelengths; those of Verasonics have up to 8."""

_SAMPLED = ("NS200BW", "custom")
"""Sample modes whose samples are equally spaced; the others take them in pairs, a quarter period apart (BS100BW …), or
in two acquisitions, half a sample apart (NS200BWI)."""

_ONE_KIND = "save one kind of them, without Event: Receive = Receive(1:2:end) for the first of two"

_SIGMA_OF_MEDIAN = 1.4826
"""Standard deviation of Gaussian noise over the median of its magnitude."""

_MIN_COMPARED = 15
"""Fewest frames whose acquisitions are compared: fewer do not show the noise."""

_ALIKE = 0.4
"""Least share of its peak that an acquisition must have where another of the same frames has its own: the energies of
laser pulses differ by less."""

_DEPTHS = 32
"""Ranges of depth in which acquisitions are compared: the laser's pick-up and the skin are in the first ones."""

_CLEAR = 10.0
"""Height of a peak over the noise of its curve from which curves are compared."""


def is_workspace(file: CheckedHdf5) -> bool:
    """Return whether a file holds the receive data of a Vantage."""
    return RCV_DATA in file.opened


def vantage_arrays(path: Path, file: CheckedHdf5) -> dict[str, np.ndarray]:
    """Return the frames of a workspace and what is known of them, named as `read_arrays` takes them.

    The acquisitions of a frame are averaged, and refused if they are no repeats; those of a buffer of one frame are
    frames themselves. The frames are in the order of the buffer, with their numbers and the number of the last one, as
    `markerseek.records.banks.arrays` needs them.
    """
    workspace = _Workspace(path=path, file=file)
    receives = workspace.receives()
    data = workspace.buffer(receives.buffer)
    columns = workspace.columns(data.shape[-2])
    numbers = workspace.frame_numbers(receives, data)
    places = [(number, np.unique(receives.start[receives.frame == number])) for number in numbers.tolist()]
    pulses = [int((receives.frame == number).sum()) for number in numbers.tolist()]
    last = workspace.last_frame(receives.buffer)
    if len(places) == 1:
        # A buffer of one frame holds a scan if each of its acquisitions has an angle.
        ((number, starts),) = places
        numbers = np.arange(1, len(starts) + 1)
        places = [(number, starts[[index]]) for index in range(len(starts))]
        pulses = [int((receives.start == start).sum()) for start in starts.tolist()]
        last = float(len(starts))
    frames = np.empty((len(places), len(columns), receives.samples), np.int16)
    strengths = []
    for index, (number, starts) in enumerate(places):
        acquired = [_acquisition(data, number, start, receives.samples, columns) for start in starts.tolist()]
        frames[index] = np.rint(np.mean(acquired, axis=0))
        strengths.append([_strengths(each) for each in acquired])
    workspace.require_alike(strengths)
    if not frames.any():
        workspace.refuse(f"{RCV_DATA} holds zeros only", "save the workspace after the acquisition")
    known = {
        "sampling_hz": receives.sampling_hz,
        "first_sample_s": receives.first_sample_s,
        "pitch_m": workspace.pitch_m(),
        "sound_speed_m_s": workspace.number("Resource.Parameters.speedOfSound"),
        LAST: last,
    }
    return {
        "frames": frames,
        "pulses": np.array(pulses),
        NUMBERS: numbers,
        **{name: np.array(value) for name, value in known.items() if value is not None},
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class _Receives:
    """The photoacoustic receives, and what they have in common."""

    frame: Int64[np.ndarray, " receives"]
    """Frame of each, counted from 1."""
    start: Int64[np.ndarray, " receives"]
    """First sample of each in its frame, counted from 1; equal ones were accumulated by the machine."""
    samples: int
    buffer: int
    """Number of their buffer, from 1."""
    sampling_hz: float
    first_sample_s: float


def _acquisition(
    data: h5py.Dataset, number: int, start: int, samples: int, columns: Int64[np.ndarray, " channels"]
) -> Int16[np.ndarray, "channels samples"]:
    """Return one acquisition of a frame; ``number`` and ``start`` count from 1."""
    rows = slice(start - 1, start - 1 + samples)
    return np.asarray((data[number - 1, :, rows] if data.ndim == 3 else data[:, rows])[columns], dtype=np.int16)


def _strengths(acquired: Int16[np.ndarray, "channels samples"]) -> Float64[np.ndarray, " depths"]:
    """Return the mean over the channels of the largest magnitude in each of some ranges of depth."""
    samples = acquired.shape[1]
    firsts = np.unique(np.linspace(0, samples, min(_DEPTHS, samples), endpoint=False, dtype=int))
    magnitudes = np.abs(acquired.astype(np.float64))
    return np.asarray(np.maximum.reduceat(magnitudes, firsts, axis=1).mean(axis=0))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Workspace:
    """The variables of a workspace, as numbers."""

    path: Path
    file: CheckedHdf5 = field(repr=False)

    def refuse(self, problem: str, cure: str = "save the workspace again") -> NoReturn:
        raise RecordError(f"{self.path}: {problem}; {cure}")

    def receives(self) -> _Receives:
        start = self._whole("Receive.startSample")
        count = len(start)
        whole = {
            name: self._whole(f"Receive.{name}", count=count, otherwise=otherwise)
            for name, otherwise in (("endSample", None), ("framenum", None), ("bufnum", 1))
        }
        chosen = self._without_transmit(count)
        samples = whole["endSample"] - start + 1
        rate_mhz = self._each("Receive.decimSampleRate", count=count)
        rate_mhz = rate_mhz / self._each("Receive.quadDecim", count=count, otherwise=1.0)
        depth = self._each("Receive.startDepth", count=count, otherwise=0.0)
        apertures = self._whole("Receive.aperture", count=count, otherwise=0)[chosen]
        if apertures.any():
            self.refuse(
                f"Receive.aperture is {apertures[apertures != 0][0]}: the probe switches its elements",
                "acquire with a probe whose elements have a channel each",
            )
        for text in self._texts("Receive.sampleMode", count=count, chosen=chosen):
            if text not in _SAMPLED:
                self.refuse(
                    f"Receive.sampleMode is {text!r}, whose samples are not equally spaced in one acquisition",
                    "acquire with sampleMode 'NS200BW'",
                )
        frequency_mhz = self.number("Trans.frequency")
        first_depth = self._same("Receive.startDepth", depth[chosen])
        if (first_depth or self.number("Trans.lensCorrection")) and not (frequency_mhz and frequency_mhz > 0):
            self.refuse(
                "Trans.frequency is missing, and Receive.startDepth and Trans.lensCorrection count its wavelengths",
                "save Trans too",
            )
        sampling_hz = 1e6 * self._same("Receive.decimSampleRate", rate_mhz[chosen])
        lens = self.number("Trans.lensCorrection") or 0.0
        if not 0 <= lens < _THICKEST_LENS:
            self.refuse(
                f"Trans.lensCorrection is {lens:g} wavelengths, 0 to {_THICKEST_LENS} are possible", "correct it"
            )
        # Depths count wavelengths to and fro, also of a receive that had no transmit. Sound crosses the lens once, and
        # comes later by that.
        first_sample_s = (2e-6 * first_depth - 1e-6 * lens) / (frequency_mhz or 1.0)
        common = int(self._same("Receive.endSample - Receive.startSample", samples[chosen]))
        if common < 1 or start.min() < 1:
            self.refuse(f"a receive begins at sample {start.min()} and has {common}")
        return _Receives(
            frame=whole["framenum"][chosen],
            start=start[chosen],
            samples=common,
            buffer=int(self._same("Receive.bufnum", whole["bufnum"][chosen])),
            sampling_hz=sampling_hz,
            first_sample_s=first_sample_s,
        )

    def _without_transmit(self, receives: int) -> Int64[np.ndarray, " receives"]:
        """Return the indices of the receives whose event has no transmit, each once, in their order.

        All where none is stated.
        """
        if self._items("Event.rcv") is None:
            return np.arange(receives)
        received = self._whole("Event.rcv")
        sent = self._whole("Event.tx", count=len(received))
        if received.max(initial=0) > receives:
            self.refuse(f"an event names receive {received.max()} of {receives}", "save the whole workspace")
        silent = [number for number in np.unique(sent).tolist() if number < 1 or self._is_silent(number)]
        chosen = np.unique(received[np.isin(sent, silent) & (received > 0)]) - 1
        if not chosen.size:
            self.refuse(
                "each of its events has a transmit, and none is photoacoustic",
                "give the photoacoustic events tx = 0 or a TX with Apod of zeros; or save it without Event",
            )
        return chosen

    def _is_silent(self, number: int) -> bool:
        """Return whether a TX, counted from 1, has an apodization of zeros."""
        items = self._items("TX.Apod")
        if items is None or number > len(items):
            self.refuse(f"an event names TX {number}, and its Apod is missing", "save TX too")
        return not self._values(items[number - 1], name="TX.Apod").any()

    def buffer(self, number: int) -> h5py.Dataset:
        """Return the samples of one buffer: (frames, channels, rows), or (channels, rows) of a single frame."""
        items = self._items(RCV_DATA) or []
        if not 1 <= number <= len(items):
            self.refuse(
                f"{RCV_DATA} has {len(items)} buffers, and the receives fill number {number}",
                f"save {RCV_DATA}",
            )
        data = items[number - 1]
        if data.ndim not in (2, 3) or data.dtype.newbyteorder("=") != np.int16 or 0 in data.shape:
            self.refuse(
                f"{RCV_DATA}{{{number}}} is {data.dtype} of shape {data.shape[::-1]}, int16 of samples × channels × "
                "frames is expected",
                f"save {RCV_DATA} as VSX leaves it",
            )
        return data

    def frame_numbers(self, receives: _Receives, data: h5py.Dataset) -> Int64[np.ndarray, " frames"]:
        """Return the numbers of the frames that the receives fill, from 1, rising."""
        frames = data.shape[0] if data.ndim == 3 else 1
        rows = data.shape[-1]
        numbers = np.unique(receives.frame)
        if numbers[0] < 1 or numbers[-1] > frames:
            self.refuse(
                f"the receives fill frames {numbers[0]} to {numbers[-1]}, and {RCV_DATA} holds {frames}",
                f"save {RCV_DATA} and Receive of one run",
            )
        if receives.start.max() + receives.samples - 1 > rows:
            self.refuse(
                f"a receive ends at sample {receives.start.max() + receives.samples - 1}, and a frame has {rows}",
                f"save {RCV_DATA} and Receive of one run",
            )
        return numbers

    def require_alike(self, strengths: list[list[Float64[np.ndarray, " depths"]]]) -> None:
        """Refuse acquisitions of a frame that are no repeats: of other wavelengths, or at other angles.

        ``strengths``: of each frame and acquisition. A source that only some of them see is what shows it.
        """
        counts = {len(each) for each in strengths}
        if counts == {1}:
            return
        if len(counts) > 1:
            self.refuse(
                f"its frames have {' and '.join(map(str, sorted(counts)))} acquisitions without a transmit", _ONE_KIND
            )
        from scipy.ndimage import median_filter

        # What all frames have in common is no source; one frame alone may have missed a pulse.
        curves = np.array(strengths).transpose(1, 0, 2)
        curves = median_filter(curves - np.median(curves, axis=1, keepdims=True), size=(1, 3, 1), mode="nearest")
        # The laser's pick-up varies with the energy of the pulses, and so counts as noise of its depths.
        scatter = _SIGMA_OF_MEDIAN * np.median(np.abs(curves), axis=1, keepdims=True)
        least = _CLEAR * np.maximum(scatter, 1.0)
        clear = (curves > least).any(axis=0)
        if not clear.any() or len(strengths) < _MIN_COMPARED:
            return
        raised = np.where(clear, np.maximum(curves, least), 0.0).reshape(len(curves), -1)
        # How strong each acquisition, of which the strongest is 1, is where another is strongest.
        shares = (raised / raised.max(axis=1, keepdims=True))[:, raised.argmax(axis=1)]
        if shares.min() < _ALIKE:
            self.refuse(
                f"the {counts.pop()} acquisitions of a frame are no repeats: where one is strongest, another has "
                f"{100 * shares.min():.0f} % of its own peak, as of two wavelengths, or at two angles",
                _ONE_KIND,
            )

    def last_frame(self, buffer: int) -> float | None:
        """Return the number of the frame of a buffer that was filled last; None if not stated."""
        last = self._items("Resource.RcvBuffer.lastFrame")
        if last is None or buffer > len(last):
            return None
        return float(self._values(last[buffer - 1], name="Resource.RcvBuffer.lastFrame").flat[0])

    def columns(self, channels: int) -> Int64[np.ndarray, " elements"]:
        """Return the channel of each element, counted from 0."""
        for name in ("ConnectorES", "Connector"):
            items = self._items(f"Trans.{name}")
            if items is None:
                continue
            wiring = self._values(items[0], name=f"Trans.{name}")
            if min(wiring.shape, default=1) > 1:
                self.refuse(f"Trans.{name} has several columns: the probe switches its elements", "use one aperture")
            numbers = self._as_whole(wiring.ravel(), name=f"Trans.{name}")
            if numbers.min() < 1 or numbers.max() > channels or len(np.unique(numbers)) < len(numbers):
                self.refuse(
                    f"Trans.{name} connects channels {numbers.min()} to {numbers.max()}, and {RCV_DATA} has {channels}",
                    "each element needs a channel of its own: save Trans of the same run",
                )
            return numbers - 1
        elements = self.number("Trans.numelements")
        if elements != channels:
            self.refuse(
                f"{RCV_DATA} has {channels} channels, Trans.numelements is {elements}, and Trans.Connector is missing",
                "save Trans too",
            )
        return np.arange(channels)

    def pitch_m(self) -> float | None:
        """Return the distance of the elements; None if not stated."""
        kind = self.number("Trans.type")
        if kind not in (None, 0):
            self.refuse(f"Trans.type is {kind:g}, the array is not linear", "only linear arrays (type 0) can be imaged")
        spacing_mm = self.number("Trans.spacingMm")
        if spacing_mm is not None:
            return 1e-3 * spacing_mm
        waves = self.number("Trans.spacing")
        frequency_mhz = self.number("Trans.frequency")
        speed_m_s = self.number("Resource.Parameters.speedOfSound")
        return waves * speed_m_s / (1e6 * frequency_mhz) if waves and speed_m_s and frequency_mhz else None

    def number(self, name: str) -> float | None:
        """Return one number by the dotted name of its variable; None if it is missing."""
        items = self._items(name)
        if items is None:
            return None
        values = self._values(items[0], name=name)
        if len(items) != 1 or values.size != 1:
            self.refuse(f"{name} holds {values.size} numbers, one is expected")
        return float(values.flat[0])

    def _each(
        self, name: str, *, count: int | None = None, otherwise: float | None = None
    ) -> Float64[np.ndarray, " items"]:
        """Return one number for each item of an array of structures; ``otherwise`` where the field is missing."""
        quick = self._scalars(name)
        if quick is not None and count in (None, len(quick)) and np.isfinite(quick).all():
            return quick
        items = self._items(name)
        if items is None and otherwise is not None and count is not None:
            return np.full(count, otherwise)
        if items is None or count not in (None, len(items)):
            found = "missing" if items is None else f"there {len(items)} times instead of {count}"
            self.refuse(
                f"{name} is {found}",
                f"save the whole workspace: save('run.mat', '-v7.3') with {name.partition('.')[0]}",
            )
        values = [self._values(item, name=name) for item in items]
        if any(each.size != 1 for each in values):
            self.refuse(f"{name} is not one number for each")
        return np.array([each.flat[0] for each in values])

    def _whole(
        self, name: str, *, count: int | None = None, otherwise: float | None = None
    ) -> Int64[np.ndarray, " items"]:
        return self._as_whole(self._each(name, count=count, otherwise=otherwise), name=name)

    def _as_whole(self, values: Float64[np.ndarray, " items"], *, name: str) -> Int64[np.ndarray, " items"]:
        if not (np.abs(values) < 2**31).all() or not (values == np.rint(values)).all():
            self.refuse(f"{name} holds {values.tolist()[:4]}, whole numbers are expected")
        return values.astype(np.int64)

    def _texts(self, name: str, *, count: int, chosen: Int64[np.ndarray, " receives"]) -> set[str]:
        """Return the different texts of a field of some structures; none where it is missing."""
        items = self._items(name)
        if items is None:
            return set()
        if len(items) != count:
            self.refuse(f"{name} is there {len(items)} times instead of {count}", "save the whole workspace")
        return {_text_of(items[index]) for index in chosen.tolist()}

    def _same(self, name: str, values: np.ndarray) -> float:
        """Return the value that all of them are."""
        different = np.unique(values)
        if len(different) != 1:
            self.refuse(
                f"{name} of the photoacoustic receives is {different.tolist()[:4]}, one value is expected",
                "acquire them alike, or save one kind of them",
            )
        return float(different[0])

    def _values(self, item: h5py.Dataset, *, name: str) -> Float64[np.ndarray, ...]:
        if item.dtype.kind not in "iuf" or item.dtype.itemsize > 8 or not 0 < item.size <= MAX_ITEMS:
            self.refuse(f"{name} is {item.dtype} of shape {item.shape}, numbers are expected")
        values = np.asarray(item[()], dtype=np.float64)
        if not np.isfinite(values).all():
            self.refuse(f"{name} holds a number that is not finite")
        return values

    def _scalars(self, name: str) -> Float64[np.ndarray, " items"] | None:
        """Return one number for each structure of an array of MATLAB; None if they are stored otherwise."""
        import h5py

        item = self._item(name)
        if not isinstance(item, h5py.Dataset) or item.dtype != h5py.ref_dtype:
            return None
        data = self.file.checked(item, name=name)
        self._require_few(data.size, name)
        return self.file.scalars(data[()].ravel(), name=name)

    def _items(self, name: str) -> list[h5py.Dataset] | None:
        """Return the datasets of a variable, or of a field of it, one for each cell or structure.

        None if it has none.
        """
        item = self._item(name)
        return None if item is None else self._expanded(item, name=name) or None

    def _item(self, name: str) -> object:
        """Return a variable, or a field of it; None if it is missing."""
        item: object = self.file.opened
        for part in name.split("."):
            item = self.file.inside(_octave_value(self.file, item), part)
        return item

    def _expanded(self, item: object, *, name: str) -> list[h5py.Dataset]:
        import h5py

        value = _octave_value(self.file, item)
        if isinstance(value, h5py.Group):
            # A cell of Octave: its items are _0, _1 …, or _00, _01 … where there are ten.
            names = sorted((each for each in value if each.startswith("_")), key=natural)
            self._require_few(len(names), name)
            cells = [_octave_value(self.file, self.file.inside(value, each)) for each in names]
            return [self.file.checked(cell, name=name) for cell in cells]
        data = self.file.checked(value, name=name)
        if data.dtype != h5py.ref_dtype:
            return [data]
        self._require_few(data.size, name)
        return [self.file.referred(reference, name=name) for reference in data[()].ravel()]

    def _require_few(self, count: int, name: str) -> None:
        if count > MAX_ITEMS:
            self.refuse(f"{name} has {count} items, at most {MAX_ITEMS} are read", "save fewer frames in a file")


def _octave_value(file: CheckedHdf5, item: object) -> object:
    """Return what a value of Octave holds; a value of MATLAB itself."""
    import h5py

    octave = isinstance(item, h5py.Group) and set(item) == {"type", "value"}
    return file.inside(item, "value") if octave else item


def _text_of(item: h5py.Dataset) -> str:
    """Return a short text: codes of characters in MATLAB, bytes in Octave."""
    if item.dtype.kind not in "iuSO" or item.size > 100 or item.dtype.itemsize > 100:
        return ""
    values = item[()]
    if item.dtype.kind in "iu":
        return "".join(chr(code) for code in np.ravel(values).astype(np.uint16).tolist())
    return b"".join(each for each in np.ravel(values).tolist() if isinstance(each, bytes)).decode("ascii", "replace")
