"""Workspaces of a Verasonics Vantage as MATLAB saves them (-v7.3): structures and cells, written by h5py."""

from __future__ import annotations

import h5py
import numpy as np

ELEMENTS = 8
CONNECTOR = (3, 1, 2, 5, 4, 6, 10, 8)
"""Channel of each element, counted from 1: two of the ten channels are connected to nothing."""


class Workspace:
    """Cells and structures in MATLAB's layout, in a file that is open for writing."""

    def __init__(self, file):
        self.file = file
        self.held = file.create_group("#refs#")

    def value(self, place, name, value):
        codes = np.array([[ord(each)] for each in value], np.uint16) if isinstance(value, str) else None
        item = place.create_dataset(name, data=np.atleast_2d(np.asarray(value, float)).T if codes is None else codes)
        item.attrs["MATLAB_class"] = np.bytes_("double" if codes is None else "char")

    def structure(self, place, name, /, **fields):
        group = place.create_group(name)
        for field, value in fields.items():
            self.value(group, field, value)
        return group

    def structures(self, place, name, /, **fields):
        """An array of structures: each field is a list of references."""
        group = place.create_group(name)
        for field, values in fields.items():
            references = []
            for value in values:
                self.value(self.held, f"r{len(self.held)}", value)
                references.append(self.held[f"r{len(self.held) - 1}"].ref)
            group.create_dataset(field, data=np.array([references], h5py.ref_dtype).T, dtype=h5py.ref_dtype)
        return group

    def cell(self, name, *arrays):
        references = []
        for array in arrays:
            self.held.create_dataset(f"r{len(self.held)}", data=array.T)
            references.append(self.held[f"r{len(self.held) - 1}"].ref)
        self.file.create_dataset(name, data=np.array([references], h5py.ref_dtype), dtype=h5py.ref_dtype)


def receives(frames, *, repeats, samples, rows_before=0):
    """The fields of ``Receive``: for each frame an acquisition with a transmit, and photoacoustic ones behind it."""
    fields = {name: [] for name in ("startSample", "endSample", "framenum", "bufnum", "decimSampleRate", "sampleMode")}
    for frame in range(frames):
        for repeat in range(1 + repeats):
            start = rows_before + repeat * samples + 1
            for name, value in zip(
                fields,
                (start, start + samples - 1, frame + 1, 1, 40.0, "BS100BW" if repeat == 0 else "NS200BW"),
                strict=True,
            ):
                fields[name].append(value)
    return fields


def write_workspace(
    path,
    frames,
    *,
    repeats=1,
    last=None,
    last_saved=True,
    start_depth=0.0,
    mixed=True,
    change=None,
    connector=CONNECTOR,
    spacing_mm=0.3,
    sound_speed_m_s=1500.0,
):
    """A workspace whose photoacoustic frames are these, (frames, elements, samples) of int16.

    ``repeats``: acquisitions of each frame, equal but for +1 and -1 that cancel. ``last``: number of the last frame, of
    a ring that has gone round; None: the last of the buffer. ``last_saved``: whether the workspace states it.
    ``mixed``: whether each frame begins with an acquisition with a transmit. ``change``:
    called with the workspace at the end.
    """
    count, elements, samples = frames.shape
    fields = receives(count, repeats=repeats, samples=samples)
    shape = ((1 + repeats) * samples + 7, max(connector), count)
    data = np.random.default_rng(5).integers(-99, 99, shape).astype(np.int16)
    turned = np.roll(frames, last or 0, axis=0)
    signs = [0] * (repeats % 2) + [1, -1] * (repeats // 2)
    for frame in range(count):
        for repeat in range(repeats):
            rows = slice((1 + repeat) * samples, (2 + repeat) * samples)
            kept = turned[frame].T + np.int16(signs[repeat]) * (turned[frame].T != 0)
            data[rows, np.array(connector) - 1, frame] = kept
    with h5py.File(path, "w", userblock_size=512) as file:
        workspace = Workspace(file)
        workspace.cell("RcvData", data)
        number = len(fields["framenum"])
        workspace.structures(file, "Receive", **fields, startDepth=[start_depth] * number)
        workspace.structure(
            file,
            "Trans",
            frequency=5.0,
            spacingMm=spacing_mm,
            type=0.0,
            numelements=float(elements),
            Connector=np.array(connector, float)[:, None],
            name="L7-4",
        )
        if mixed:
            sent = [1 if index % (1 + repeats) == 0 else 2 * (index % 2) for index in range(number)]
            workspace.structures(file, "Event", tx=[*sent, 0], rcv=[*range(1, number + 1), 0])
            workspace.structures(file, "TX", Apod=[np.ones(elements), np.zeros(elements)])
        resource = file.create_group("Resource")
        workspace.structure(resource, "Parameters", speedOfSound=sound_speed_m_s)
        if last_saved:
            workspace.structure(resource, "RcvBuffer", lastFrame=float(last or count))
        if change is not None:
            change(workspace)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path
