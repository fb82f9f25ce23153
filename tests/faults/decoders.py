"""File decoders as functions of bytes, a small valid file for each, and the outcome of a reading."""

from __future__ import annotations

import io
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

from markerseek.core import RecordError
from markerseek.records.banks import (
    BankFacts,
    FrameBank,
    IntensityBank,
    load_frame,
    open_ultrasonix,
    read_arrays,
    read_bank,
    whole_bank,
)
from markerseek.records.banks.ipasc import read_probed, walk_bank
from markerseek.records.named_arrays import read_mat73
from markerseek.wire import sonixdaq

_FRAME = np.arange(2 * 6, dtype=np.int16).reshape(2, 6)
_ANGLES = np.array([-1.0, 0.0, 2.0])


def _whole_daq() -> bytes:
    return sonixdaq.encode_file(_FRAME, number=5)


def _whole_ultrasonix(number: int) -> bytes:
    """Two frames of type 4 (B-mode) or 16 (radio frequency), 3 lines of 4."""
    bits = 8 if number == 4 else 16
    corners = (0, 0, 2, 0, 2, 3, 0, 3)
    header = struct.pack("<19i", number, 2, 3, 4, bits, *corners, 1, 5_000_000, 40_000_000, 20, 128, 0)
    return header + bytes(range(24)) * (bits // 8)


def _whole_mat() -> bytes:
    stream = io.BytesIO()
    savemat(stream, {"angle_deg": _ANGLES, "frames": np.stack([_FRAME] * 3)})
    return stream.getvalue()


def _whole_frame_mat() -> bytes:
    stream = io.BytesIO()
    frame = np.arange(32 * 2 * 4, dtype=np.int16).reshape(32, 2, 4)
    savemat(stream, {"AdcData_frame000": frame, "SampleNum": 2.0}, do_compression=True)
    return stream.getvalue()


def _whole_mat73() -> bytes:
    """Angles in one piece, frames in compressed chunks, and a variable that is passed over."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mat"
        with h5py.File(path, "w", userblock_size=512) as file:
            file["angle_deg"] = _ANGLES[:, None]
            frames = np.stack([_FRAME] * 3).T
            file.create_dataset("frames", data=frames, chunks=(3, 2, 3), compression="gzip", shuffle=True)
            file["note"] = np.array([[77, 65]], np.uint16)
            for name, kind in (("angle_deg", "double"), ("frames", "int16"), ("note", "char")):
                file[name].attrs["MATLAB_class"] = np.bytes_(kind)
        return b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + path.read_bytes()[128:]


def _whole_npy() -> bytes:
    stream = io.BytesIO()
    np.save(stream, _FRAME)
    return stream.getvalue()


def _whole_npz() -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, angle_deg=_ANGLES, intensity=_ANGLES**2)
    return stream.getvalue()


def _whole_csv() -> bytes:
    return b'angle_deg,intensity,note\n-1,2.5,"a"\n0,3,b\n2,1e-3,c\n'


def _whole_mha() -> bytes:
    """Three frames of 2 lines of 6 samples, packed."""
    fields = [f"Seq_Frame{number:04d}_ProbeRotation = {angle}" for number, angle in enumerate(_ANGLES)]
    head = [
        "DimSize = 6 2 3",
        "ElementType = MET_SHORT",
        "CompressedData = True",
        "UltrasoundImageType = RF_REAL",
        *fields,
        "ElementDataFile = LOCAL\n",
    ]
    return "\n".join(head).encode() + zlib.compress(np.stack([_FRAME] * 3).tobytes())


def _whole_hdf5() -> bytes:
    from markerseek.core import ChannelFrame, FrameHeader, Reading, Sample

    header = FrameHeader(sequence=1, token="a", pulses=16, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
    frame = ChannelFrame(header=header, samples=_FRAME, sampling_hz=40e6)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.hdf5"
        facts = BankFacts(description="simulated", sampling_hz=40e6, pitch_m=0.43e-3, sound_speed_m_s=1540.0)
        with whole_bank(path, facts=facts) as writer:
            writer.add(Sample(angle_deg=0.0, reading=Reading(intensity=0.0), dark=True, frame=frame))
            for angle_deg in _ANGLES:
                writer.add(Sample(angle_deg=float(angle_deg), reading=Reading(intensity=1.0), frame=frame))
        return path.read_bytes()


def _frames_of(bank: IntensityBank | FrameBank) -> None:
    if isinstance(bank, FrameBank):
        for index in range(len(bank.angles_deg)):
            bank.frame(index)
        for index in range(bank.dark_frames):
            bank.dark_frame(index)


def _read_daq(path: Path) -> None:
    data = path.read_bytes()
    header = sonixdaq.decode_header(data[: sonixdaq.HEADER_BYTES], size=len(data), name=path.name)
    sonixdaq.decode_samples(data[header.length :], header)


def _read_ultrasonix(path: Path) -> None:
    file = open_ultrasonix(path)
    for index in range(min(file.header.frames, 3)):
        (file.b_mode if file.header.kind == "b-mode" else file.rf)(index)


def _read_probed_hdf5(path: Path) -> None:
    walk_bank(path)
    _frames_of(read_probed(path))


DECODERS: dict[str, tuple[str, Callable[[], bytes], Callable[[Path], object]]] = {
    "daq": ("CH005.daq", _whole_daq, _read_daq),
    "b8": ("a.b8", lambda: _whole_ultrasonix(4), _read_ultrasonix),
    "rf": ("a.rf", lambda: _whole_ultrasonix(16), _read_ultrasonix),
    "mat": ("a.mat", _whole_mat, lambda path: _frames_of(read_arrays(path))),
    "mat73": ("a.mat", _whole_mat73, lambda path: _frames_of(read_arrays(path))),
    "mat-frame": ("a.mat", _whole_frame_mat, load_frame),
    "npy": ("a.npy", _whole_npy, load_frame),
    "npz": ("a.npz", _whole_npz, lambda path: _frames_of(read_arrays(path))),
    "csv": ("a.csv", _whole_csv, read_bank),
    "mha": ("a.mha", _whole_mha, read_bank),
    "hdf5": ("a.hdf5", _whole_hdf5, lambda path: _frames_of(read_bank(path))),
}
"""File's name, a whole file, and what reads it, by the decoder's name."""

IN_THIS_PROCESS = {
    **DECODERS,
    "hdf5": ("a.hdf5", _whole_hdf5, _read_probed_hdf5),
    "mat73": ("a.mat", _whole_mat73, read_mat73),
}
"""The same, HDF5 without the child process."""


def outcome(read: Callable[[Path], object], path: Path, data: bytes) -> str:
    """``read`` or ``refused``; any other error comes through."""
    path.write_bytes(data)
    return read_or_refused(lambda: read(path), RecordError)


def read_or_refused(read: Callable[[], object], refusal: type[Exception]) -> str:
    """``read`` or ``refused``; any other error comes through."""
    try:
        read()
    except refusal as refused:
        if not str(refused):
            raise AssertionError("a refusal without a sentence") from refused
        return "refused"
    return "read"


def zip_bomb() -> bytes:
    """An ``.npz`` of some kilobytes that claims a hundred megabytes of zeros."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        inner = io.BytesIO()
        np.lib.format.write_array_header_1_0(
            inner, {"descr": "<f8", "fortran_order": False, "shape": (100_000_000 // 8,)}
        )
        archive.writestr("intensity.npy", inner.getvalue() + bytes(100_000_000))
    return stream.getvalue()
