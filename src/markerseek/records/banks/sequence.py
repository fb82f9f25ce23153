"""Reads sequences of images with fields for each: MetaImage (``.igs.mha``, ``.mha``, ``.mhd``) and NRRD, as of PLUS.

An `ImageSequence` is the header; frames are read one at a time, so that memory is needed for one only. The angle of a
frame is in a field in degrees, or in a transform, whose twist about one axis of its coordinates is taken: the axis that
moves least. For ``ProbeToProbeHome`` this is y, and the angle is that of `sequence_writer`; for ``ProbeToStepperHome``
of PLUS it is z.

The intensity of an image is its largest pixel, that of radio-frequency lines the largest value of their envelope. A
machine has beamformed such lines: they are not channel data, so that their bank holds intensities.
"""

from __future__ import annotations

import math
import os
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import msgspec
import numpy as np

from markerseek.core import Float64, RecordError
from markerseek.files import MIB, as_read_error, open_input, quoted
from markerseek.records.banks.bank import BankFacts, IntensityBank, first_of, unwrapped
from markerseek.records.banks.repeats import merged
from markerseek.records.banks.table import amplitudes
from markerseek.records.banks.table_angles import deg_per_unit_of, stated_deg
from markerseek.records.banks.table_format import DEFAULT_FORMAT, TableFormat
from markerseek.records.notes import note

SEQUENCE_SUFFIXES = (".mha", ".mhd", ".nrrd", ".nhdr")
"""Suffixes of sequences; those of PLUS end in ``.igs.mha`` or ``.igs.nrrd``."""

ANGLE_FIELDS = ("ProbeRotation", "trus_angle_deg", "angle_deg")
"""Fields with an angle in degrees, in the order in which they are looked for."""

_NO_ANGLES = frozenset({"Timestamp", "UnfilteredTimestamp", "FrameNumber"})
"""Fields of each frame that PLUS writes beside its transforms."""

ANGLE_TRANSFORMS = ("ProbeToProbeHome", "ProbeHomeToProbe", "ProbeToStepperHome")
"""Transforms that turn with the probe, looked for where a sequence has none of the fields."""

_STEPPER = {"ProbeRotation": "ProbeToStepperHomeTransformStatus", "angle_deg": "ProbeToProbeHomeTransformStatus"}
"""Status of the device that a field was read from; the field itself has none, and keeps its last value."""

_TYPES = {
    "u1": "MET_UCHAR, uchar, unsigned char, uint8, uint8_t",
    "i1": "MET_CHAR, signed char, int8, int8_t",
    "u2": "MET_USHORT, ushort, unsigned short, unsigned short int, uint16, uint16_t",
    "i2": "MET_SHORT, short, short int, signed short, signed short int, int16, int16_t",
    "u4": "MET_UINT, uint, unsigned int, uint32, uint32_t",
    "i4": "MET_INT, int, signed int, int32, int32_t",
    "f4": "MET_FLOAT, float",
    "f8": "MET_DOUBLE, double",
}
_TYPE_OF = {name: code for code, names in _TYPES.items() for name in names.split(", ")}

_LARGEST_BYTES = 1 << 42
_HEADER_BYTES = 64 * MIB
_LINE_BYTES = 64 * 1024
_MOST_FRAME_BYTES = 64 * MIB
_MOST_INTERLEAVED_BYTES = 2048 * MIB
_MOST_FRAMES = 100_000
_PIECE_BYTES = 64 * 1024
_MOST_PER_BYTE = 1032
"""DEFLATE cannot make more of a byte."""

_MOST_TILT_DEG = 1.0
"""Most by which a turn may tilt its axis; an axis beside the true one by so much changes an angle of 35° by 0.02°."""

_LINES = ("RF_REAL", "RF_IQ_LINE", "RF_I_LINE_Q_LINE")
"""Types of images that are lines of radio frequency: real, I and Q in turn in a line, lines of I and of Q in turn."""

_FRAME_FIELD = re.compile(r"(?:Seq_Frame|sequence frame ?)(\d{1,6})[_ ](.+)", re.ASCII)

_TYPES_OF_IMAGES = (*_LINES, "BRIGHTNESS", "RGB_COLOR", "XX", "")
"""Types of images in PLUS's words; XX is unknown."""

_NEUTRAL = {
    "ElementToIntensityFunctionSlope": "1",
    "ElementToIntensityFunctionOffset": "0",
    "space units": "mm",
    "units": "mm",
    **dict.fromkeys(("old min", "oldmin", "old max", "oldmax", "axis mins", "axismins", "axis maxs", "axismaxs"), ""),
}
"""Fields that would change the pixels or their size, and the value that changes nothing; empty where none does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageSequence:
    """Header of a sequence, checked against the size of its data."""

    path: Path
    fields: Mapping[str, str] = field(repr=False)
    """Fields of the whole file."""
    frame_fields: Sequence[Mapping[str, str]] = field(repr=False)
    """Fields of each frame."""
    dtype: str
    shape: tuple[int, int, int]
    """Rows, columns and components of a frame, as they lie in the file."""
    spacing: tuple[float, ...]
    """Distance between columns and between rows, in millimetres or pixels."""
    data: Path
    start: int
    """Where in ``data`` the pixels begin."""
    packed: bool
    interleaved: bool = False
    """Whether the frames take turns in each pixel, as where the list is the first axis of a NRRD."""

    @property
    def kind(self) -> str:
        """One of `_LINES`, ``BRIGHTNESS`` (B-mode), or ``ENVELOPE``."""
        kind = self.fields.get("UltrasoundImageType", "").upper()
        if kind in _LINES:
            return kind
        if self.dtype[-2] == "f":
            return "ENVELOPE"
        # PLUS keeps lines of radio frequency with the depth along the columns.
        lines = not kind and self.dtype[-2:] == "i2" and self.orientation[0] in "FN"
        return "RF_REAL" if lines else "BRIGHTNESS"

    @property
    def orientation(self) -> str:
        """Where columns and rows run, in PLUS's letters: M or U across, F or N in depth."""
        named = self.fields.get("UltrasoundImageOrientation", "").upper()[:2]
        usual = "FM" if self.fields.get("UltrasoundImageType", "").upper() in _LINES else "MF"
        return usual if named in ("", "XX") else named

    def valid_image(self, number: int) -> bool:
        """Return whether a frame, counted from 0, has an image; as in PLUS, one without a status has."""
        return self.frame_fields[number].get("ImageStatus", "OK").upper() == "OK"

    @property
    def pixel_m(self) -> tuple[float, float] | None:
        """Height and width of a pixel by ImageToProbe or the spacing; None if both only count pixels."""
        sizes = self.spacing
        matrices = (
            _numbers(value, 16)
            for fields in self.frame_fields
            for name, value in fields.items()
            if name.startswith("ImageTo") and name.endswith("Transform") and fields.get(f"{name}Status") == "OK"
        )
        matrix = next((each for each in matrices if each is not None), None)
        if matrix is not None:
            across, down = np.linalg.norm(matrix.reshape(4, 4)[:3, :2], axis=0).tolist()
            sizes = (sizes[0] * across, sizes[1] * down)
        if sizes == (1.0, 1.0):
            return None
        width_m, height_m = (1e-3 * size for size in sizes)
        return (width_m, height_m) if self.orientation[0] in "FN" else (height_m, width_m)

    def frames(self) -> Iterator[np.ndarray]:
        """Yield each frame with depth along its rows and the marked side at its last column.

        The brightest of colours.
        """
        columns = self.orientation[:1]
        rows = self.orientation[1:]
        with as_read_error(self.data), open_input(self.data, most_bytes=_LARGEST_BYTES) as file:
            file.seek(self.start)
            for pixels in self._pixels(file):
                frame = pixels.astype(pixels.dtype.newbyteorder("=")).max(axis=-1)
                frame = frame[:, ::-1] if columns in "UN" else frame
                frame = frame[::-1] if rows in "UN" else frame
                yield frame.T if columns in "FN" else frame

    def _pixels(self, file: BinaryIO) -> Iterator[np.ndarray]:
        """Yield the pixels of each frame as they lie in the file, at which its data begin."""
        size = math.prod(self.shape) * np.dtype(self.dtype).itemsize
        count = len(self.frame_fields)
        if not self.interleaved:
            for piece in _unpacked(self.path, file, size, count, packed=self.packed):
                yield np.frombuffer(piece, self.dtype).reshape(self.shape)
            return
        if size * count > _MOST_INTERLEAVED_BYTES:
            raise RecordError(
                f"{self.path}: its list is the first axis, so that its frames are read together: they have "
                f"{size * count} bytes, at most {_MOST_INTERLEAVED_BYTES} are read; save it with the list last"
            )
        (whole,) = _unpacked(self.path, file, size * count, 1, packed=self.packed)
        yield from np.moveaxis(np.frombuffer(whole, self.dtype).reshape((*self.shape, count)), -1, 0)


def is_sequence(path: Path) -> bool:
    """Return whether a file is named as a sequence."""
    return path.suffix.lower() in SEQUENCE_SUFFIXES and not path.is_dir()


def open_sequence(path: Path) -> ImageSequence:
    """Return the header of a sequence; `RecordError` if it is none, or its data have another size."""
    with as_read_error(path), open_input(path, most_bytes=_LARGEST_BYTES) as file:
        nrrd = path.suffix.lower() in (".nrrd", ".nhdr")
        held = _lines(path, file, nrrd=nrrd)
        start = file.tell()
    said = {name: value for name, value in held.items() if not _FRAME_FIELD.fullmatch(name)}
    if nrrd:
        said = _as_meta(path, said)
    _require_understood(path, said)
    if said.get("BinaryData", "True").lower() != "true" or said.get("HeaderSize", "0") != "0":
        raise RecordError(f"{path}: its pixels are text, or have a header of their own; save it as binary")
    columns, rows, components, frames = _sizes(path, said)
    per_frame: list[dict[str, str]] = [{} for _ in range(frames)]
    for name, value in held.items():
        match = _FRAME_FIELD.fullmatch(name)
        if match and int(match[1]) < frames:
            # A NRRD of PLUS has another name for it than a MetaImage.
            status = nrrd and match[2].lower() in ("status", "image status")
            per_frame[int(match[1])]["ImageStatus" if status else match[2]] = value
    place = said.get("ElementDataFile", "LOCAL")
    local = place.upper() == "LOCAL"
    if Path(place).name != place or place.startswith("LIST"):
        raise RecordError(f"{path}: its pixels are in {place[:80]!r}; keep them in one file beside it")
    order = said.get("BinaryDataByteOrderMSB", said.get("ElementByteOrderMSB", ""))
    sequence = ImageSequence(
        path=path,
        fields=said,
        frame_fields=per_frame,
        dtype=(">" if order.lower() == "true" else "<") + _TYPE_OF[said["ElementType"]],
        shape=(rows, columns, components),
        spacing=_spacing(said.get("ElementSpacing", said.get("ElementSize", "")).split()),
        data=path if local else path.with_name(place),
        start=start if local else 0,
        packed=said.get("CompressedData", "").lower() == "true",
        interleaved=said.get(_INTERLEAVED) == "True",
    )
    with as_read_error(sequence.data), open_input(sequence.data, most_bytes=_LARGEST_BYTES) as file:
        held_bytes = os.fstat(file.fileno()).st_size - sequence.start
    stated = frames * math.prod(sequence.shape) * np.dtype(sequence.dtype).itemsize
    if held_bytes * _MOST_PER_BYTE < stated if sequence.packed else held_bytes != stated:
        raise RecordError(
            f"{path}: {frames} frames of {columns} × {rows} have {stated} bytes, and the file holds {held_bytes}"
            f"{' packed ones' if sequence.packed else ''}; it is cut off or damaged: fetch or save it again"
        )
    return sequence


def angles_of(sequence: ImageSequence, *, angle_field: str | None = None) -> dict[int, float]:
    """Return the angle in degrees of each frame with a valid image and angle, by its number.

    A warning names the others.

    ``angle_field``: name of the field or transform; None: the first of `ANGLE_FIELDS` and `ANGLE_TRANSFORMS` that the
    sequence has.
    """
    path = sequence.path
    frames = sequence.frame_fields
    names = {name for fields in frames for name in fields}
    chosen = _field_of_angles(path, names, angle_field)
    turns = chosen.endswith("Transform")
    status = f"{chosen}Status" if turns else _STEPPER.get(chosen, f"{chosen}Status")
    stated = {status, f"{status.removesuffix('Status')}Valid"} & names
    usual = "missing" if turns or stated else "OK"
    kept: dict[int, np.ndarray] = {}
    left_out: list[str] = []
    for number, each in enumerate(frames):
        said = _validity(each, status, usual)
        values = _numbers(each.get(chosen, ""), 16 if turns else 1)
        if not sequence.valid_image(number):
            left_out.append(f"Seq_Frame{number:04d} (ImageStatus {each['ImageStatus']})")
        elif said.upper() != "OK":
            left_out.append(f"Seq_Frame{number:04d} ({status} {said})")
        elif values is None:
            left_out.append(f"Seq_Frame{number:04d} ({chosen} {each.get(chosen, 'missing')[:40]})")
        else:
            kept[number] = values
    if left_out:
        note(path, f"{len(left_out)} of {len(frames)} frames are left out: {first_of(left_out)}")
    if not kept:
        raise RecordError(f"{path}: no frame has a valid image and angle; name the field with the angle: `angle_field`")
    stacked = np.stack(list(kept.values()))
    if turns:
        angles_deg = _twists(path, chosen, stacked.reshape(-1, 4, 4)[:, :3, :3])
    else:
        cure = "state the angles, `first_and_step_deg=(-35, 0.5)`, or `angles_deg`; or write them in one of"
        angles_deg = (stacked[:, 0] * deg_per_unit_of(path, chosen, cure=cure)).tolist()
    return dict(zip(kept, unwrapped(path, np.array(angles_deg)).tolist(), strict=True))


def _validity(fields: Mapping[str, str], status: str, usual: str) -> str:
    """Return the status of a transform or field.

    Older servers state ``…Valid``, 1 or 0, beside it or in place of it.
    """
    valid = fields.get(f"{status.removesuffix('Status')}Valid")
    if valid is not None and valid.lower() not in ("1", "true"):
        return f"not valid: {valid[:20]}"
    return fields.get(status, usual if valid is None else "OK")


def _field_of_angles(path: Path, names: set[str], angle_field: str | None) -> str:
    """Return the name of the field that has the angles."""
    if angle_field in _NO_ANGLES:
        raise RecordError(
            f"{path}: {angle_field} counts time or frames, and is no angle; name another field, or a transform"
        )
    if angle_field is not None:
        wanted: tuple[str, ...] = (angle_field, f"{angle_field.removesuffix('Transform')}Transform")
    else:
        wanted = (*ANGLE_FIELDS, *(f"{name}Transform" for name in ANGLE_TRANSFORMS))
    chosen = next((name for name in wanted if name in names), None)
    if chosen is None:
        held = ", ".join(sorted(each for each in names if not each.endswith(("Status", "Valid")))[:8]) or "none"
        raise RecordError(
            f"{path}: no frame has {angle_field or ' or '.join(wanted)}; its fields are {held}; name the one with the "
            "angle, `angle_field`, or state the angles: `first_and_step_deg=(-35, 0.5)`, or `angles_deg`"
        )
    return chosen


def _stated_angles(sequence: ImageSequence, table: TableFormat) -> dict[int, float]:
    """Return the angle that a person states for each frame with a valid image, by its number.

    A warning counts the others.
    """
    count = len(sequence.frame_fields)
    stated = stated_deg(table, sequence.path, count, what="frames").tolist()
    held = {name for fields in sequence.frame_fields for name in fields}
    own = [name for name in (*ANGLE_FIELDS, *(f"{each}Transform" for each in ANGLE_TRANSFORMS)) if name in held]
    if own:
        note(sequence.path, f"the angles are those that are stated, and its {own[0]} is not read")
    valid = [number for number in range(count) if sequence.valid_image(number)]
    if len(valid) < count:
        note(sequence.path, f"{count - len(valid)} of {count} frames are left out: their ImageStatus is not OK")
    return {number: stated[number] for number in valid}


def read_sequence(path: Path, *, angle_field: str | None = None, table: TableFormat = DEFAULT_FORMAT) -> IntensityBank:
    """Return the bank of the intensities of a sequence, with the times of its frames.

    Images of one angle are averaged, with a warning. B-mode images are refused.

    ``angle_field``: as of `angles_of`. ``table``: angles that a person states instead.
    """
    sequence = open_sequence(path)
    if sequence.kind == "BRIGHTNESS":
        rows, columns, _ = sequence.shape
        raise RecordError(
            f"{path}: it holds {len(sequence.frame_fields)} B-mode images of {columns} × {rows} pixels: these are "
            f"echoes, and show no photoacoustic marker; find an instrument's tip: `sensitive_range({quoted(path)})`"
        )
    angles = _stated_angles(sequence, table) if table.states_angles else angles_of(sequence, angle_field=angle_field)
    frames = enumerate(sequence.frames())
    found = {number: _intensity(frame, sequence.kind) for number, frame in frames if number in angles}
    dark = [number for number, value in found.items() if not math.isfinite(value)]
    if dark:
        named = first_of([f"Seq_Frame{number:04d}" for number in dark])
        raise RecordError(
            f"{path}: the pixels of {named} are no finite numbers; write ImageStatus = INVALID for such frames"
        )
    numbers = list(angles)
    read = np.array([found[number] for number in numbers])
    values = amplitudes(read, db=False, where=lambda index: f"{path}, Seq_Frame{numbers[index]:04d}")
    facts, first_s = _facts(path, sequence.fields)
    times_s = [first_s + _number(sequence.frame_fields[number].get("Timestamp", "nan")) for number in numbers]
    scan = merged(path, np.array(list(angles.values())), lambda: values)
    intensities, started_s = scan.mean(np.column_stack([values, times_s])).T.tolist()
    known = any(map(math.isfinite, started_s))
    return IntensityBank(
        angles_deg=scan.angles_deg,
        intensities=tuple(intensities),
        started_s=tuple(started_s) if known else (),
        facts=facts,
    )


def _require_understood(path: Path, said: Mapping[str, str]) -> None:
    """Refuse what would change the pixels, their size or their place in a frame, and is not read."""
    orientation = said.get("UltrasoundImageOrientation", "")
    kind = said.get("UltrasoundImageType", "")
    if not re.fullmatch("([MU][FN]|[FN][MU]|XX|)[AD]?", orientation.upper()):
        raise RecordError(
            f"{path}: UltrasoundImageOrientation is {orientation[:40]!r}, M or U across and F or N in depth are "
            "understood; correct it"
        )
    if kind.upper() not in _TYPES_OF_IMAGES:
        known = ", ".join(filter(None, _TYPES_OF_IMAGES))
        raise RecordError(f"{path}: UltrasoundImageType is {kind[:40]!r}, it must be one of: {known}; correct it")
    for name, neutral in _NEUTRAL.items():
        words = {word.strip("\"'") for word in said.get(name, "").split()} - {"", "none", "???"}
        if any(word != neutral and _number(word) != _number(neutral) for word in words):
            expected = f"{neutral} is expected" if neutral else "only files without it are read"
            raise RecordError(
                f"{path}: its header has {name}, {said[name][:40]!r}, and {expected}; save the pixels as they were "
                "acquired, with spacings in millimetres"
            )


def _lines(path: Path, file: BinaryIO, *, nrrd: bool) -> dict[str, str]:
    """Return the fields of a header by name; the file is left where the pixels begin."""
    kind = "a NRRD" if nrrd else "a MetaImage"
    held: dict[str, str] = {}
    if nrrd and not file.readline(_LINE_BYTES).startswith(b"NRRD"):
        raise RecordError(f"{path}: it does not begin as {kind} does; save it again, or correct its suffix")
    while file.tell() < _HEADER_BYTES:
        line = file.readline(_LINE_BYTES)
        text = line.decode("latin-1").strip()
        if nrrd and not text and (line or held.get("data file") or held.get("datafile")):
            return held
        name, mark, value = text.partition(":" if nrrd else "=")
        if nrrd and text.startswith("#"):
            continue
        if not line.endswith(b"\n") or not mark or "\0" in text:
            break
        held[name.strip()] = value.removeprefix("=").strip() if nrrd else value.strip()
        if name.strip() == "ElementDataFile":
            return held
    raise RecordError(f"{path}: its header, of {kind}, is cut off or damaged: fetch or save it again")


_META_NAMES = {
    "ultrasound image orientation": "UltrasoundImageOrientation",
    "ultrasound image type": "UltrasoundImageType",
    "sizes": "DimSize",
    "kinds": "Kinds",
    "type": "ElementType",
    "spacings": "ElementSpacing",
    "data file": "ElementDataFile",
    "datafile": "ElementDataFile",
}
"""Names of a MetaImage for those of a NRRD."""

_INTERLEAVED = "list first"
"""Name of what a MetaImage cannot say."""


def _as_meta(path: Path, said: Mapping[str, str]) -> dict[str, str]:
    """Return the fields of a NRRD as those of a MetaImage."""
    meta = {_META_NAMES.get(name.lower(), name): value for name, value in said.items()}
    if "ElementSpacing" not in meta and "space directions" in said:
        # Of each axis its vector, whose length is the distance of two pixels, or none.
        axes = re.findall(r"none|\(([^()]*)\)", said["space directions"])
        steps = [np.linalg.norm([_number(word) for word in axis.split(",")]) for axis in axes]
        meta["ElementSpacing"] = " ".join(f"{step:.17g}" for step in steps)
    encoding = meta.get("encoding", "").lower()
    if encoding not in ("raw", "gzip", "gz") or {"line skip", "lineskip", "byte skip", "byteskip"} & set(said):
        raise RecordError(f"{path}: its encoding is {encoding!r}, or bytes are to be skipped; save it as raw or gzip")
    meta |= {"CompressedData": str(encoding != "raw"), "BinaryDataByteOrderMSB": str(meta.get("endian") == "big")}
    if meta.get("Kinds", "").split()[:1] in (["vector"], ["RGB-color"], ["RGBA-color"]):
        for name in ("DimSize", "Kinds", "ElementSpacing"):
            first, _, meta[name] = meta.get(name, "").partition(" ")
            meta |= {"ElementNumberOfChannels": first} if name == "DimSize" else {}
    elif meta.get("Kinds", "").lower().split()[:1] in (["list"], ["time"]):
        # Sequences of 3D Slicer have the list first.
        for name in ("DimSize", "Kinds", "ElementSpacing"):
            first, _, others = meta.get(name, "").partition(" ")
            meta[name] = f"{others} {first}".strip()
        meta[_INTERLEAVED] = "True"
    return meta


def _sizes(path: Path, said: Mapping[str, str]) -> tuple[int, int, int, int]:
    """Return the columns, rows, components and frames; refused where they are no images in a row."""
    sizes = said.get("DimSize", "").split()
    kind = said.get("ElementType", "")
    kinds = said.get("Kinds", "").lower().split() or ["domain"] * (len(sizes) - 1) + ["list"]
    words = [*sizes, said.get("ElementNumberOfChannels", "1")]
    numbers = [int(word) if word.isdecimal() and len(word) < 12 else 0 for word in words]
    fits = len(sizes) == len(kinds) in (3, 4) and not {"list", "time"} & set(kinds[:-1])
    if not fits or min(numbers) < 1 or any(each != 1 for each in numbers[2:-2]) or kind not in _TYPE_OF:
        size = " ".join(sizes)[:60] or "nothing"
        axes = " ".join(kinds)[:60]
        raise RecordError(
            f"{path}: it holds {kind[:40] or 'no type'} of {size} ({axes}); numbers with columns, rows and frames "
            "in this order (domain domain list) are expected: save it again"
        )
    columns, rows, frames, components = *numbers[:2], *numbers[-2:]
    stated = columns * rows * components * np.dtype(_TYPE_OF[kind]).itemsize
    if stated > _MOST_FRAME_BYTES or frames > _MOST_FRAMES:
        raise RecordError(
            f"{path}: {frames} frames of {stated} bytes, at most {_MOST_FRAMES} of {_MOST_FRAME_BYTES} are read; its "
            "header is damaged: save it again"
        )
    return columns, rows, components, frames


def _spacing(words: list[str]) -> tuple[float, float]:
    values = [_number(word) for word in words[:2]]
    return (values[0], values[1]) if len(values) == 2 and all(0 < each < math.inf for each in values) else (1.0, 1.0)


def _unpacked(path: Path, file: BinaryIO, size: int, count: int, *, packed: bool) -> Iterator[bytes]:
    """So many pieces of one size; `RecordError` where there are fewer, or where packed ones hold more."""
    # 47: zlib, as in a MetaImage, or gzip, as in a NRRD.
    inflate = zlib.decompressobj(wbits=47)
    held = bytearray()
    try:
        for _ in range(count):
            while len(held) < size and (more := file.read(_PIECE_BYTES)):
                held += inflate.decompress(more) if packed else more
            if len(held) < size:
                raise RecordError(f"{path}: its pixels end too early; it is cut off: fetch or save it again")
            yield bytes(held[:size])
            del held[:size]
        if packed and (held or inflate.decompress(file.read(_PIECE_BYTES)) or not inflate.eof):
            raise RecordError(f"{path}: its pixels do not end where its header says; it is damaged: save it again")
    except zlib.error as problem:
        raise RecordError(f"{path}: its pixels cannot be unpacked: {problem}; fetch or save it again") from problem


def _number(text: str) -> float:
    """Return a number, NaN where there is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _numbers(text: str, count: int) -> Float64[np.ndarray, " numbers"] | None:
    """So many finite numbers; None if they are others."""
    values = np.array([_number(word) for word in text.split()[: count + 1]])
    return values if values.size == count and np.isfinite(values).all() else None


def _twists(path: Path, name: str, stacked: Float64[np.ndarray, "frames 3 3"]) -> list[float]:
    """Turn of each transform about the axis that all of them leave in its place."""
    off = np.abs(stacked @ stacked.transpose(0, 2, 1) - np.eye(3)).max()
    # Six digits are usual.
    if off > 1e-3 or np.linalg.det(stacked).min() < 0:
        raise RecordError(f"{path}: {name} is no rotation in each frame; name another: `angle_field`")
    third = int(np.argmax(np.min(stacked.diagonal(axis1=1, axis2=2), axis=0)))
    tilt_deg = np.degrees(np.arccos(np.clip(stacked[:, third, third].min(), -1, 1)))
    if tilt_deg > _MOST_TILT_DEG:
        raise RecordError(
            f"{path}: {name} tilts the axis {'xyz'[third]} by up to {tilt_deg:.3g} deg, at most {_MOST_TILT_DEG:g} deg "
            "are expected of a probe that turns about its axis; name a transform to the probe's frame at 0 deg: "
            "`angle_field=ProbeToProbeHome`"
        )
    first = (third + 1) % 3
    second = (third + 2) % 3
    sine = stacked[:, second, first] - stacked[:, first, second]
    degrees = np.degrees(np.arctan2(sine, stacked[:, first, first] + stacked[:, second, second])).tolist()
    # ProbeHomeToProbe is the inverse of ProbeToProbeHome.
    source, _, target = name.removesuffix("Transform").partition("To")
    inverse = source.endswith("Home") and not target.endswith("Home")
    return [-each if inverse else each for each in degrees]


def _intensity(frame: np.ndarray, kind: str) -> float:
    """Return the largest value of the envelope."""
    if kind == "ENVELOPE":
        return float(frame.max())
    lines = frame.T.astype(np.float64)
    if kind != "RF_REAL":
        # I and Q of a pair are beside one another along a line, or in neighbouring lines.
        pairs = lines if kind == "RF_IQ_LINE" else lines.T
        return float(np.hypot(pairs[:, :-1:2], pairs[:, 1::2]).max(initial=0))
    spectrum = np.fft.rfft(lines - lines.mean(axis=1, keepdims=True))
    return float(np.abs(np.fft.ifft(2 * spectrum, n=lines.shape[1])).max())


def _facts(path: Path, said: Mapping[str, str]) -> tuple[BankFacts, float]:
    """Return the facts of a sequence that markerseek has exported, and when its first frame was taken."""
    known = {name.removeprefix("markerseek_"): value for name, value in said.items() if name.startswith("markerseek_")}
    try:
        facts = msgspec.convert(known, BankFacts, strict=False)
    except msgspec.ValidationError as problem:
        raise RecordError(f"{path}: its fields markerseek_… cannot be read: {problem}; export it again") from problem
    first_s = _number(known.get("first_time_s", "0"))
    # NaN, where the frames were only numbered.
    first_s = math.nan if known.get("times", "").startswith("not known") else first_s
    return facts, first_s - (facts.clock_zero_unix_s or 0.0)
