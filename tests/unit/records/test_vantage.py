"""Workspaces of a Verasonics: the photoacoustic frames as they were written, or a sentence that says what to save."""

from __future__ import annotations

import shutil
import subprocess

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from markerseek.core import RecordError
from markerseek.records.banks import TableFormat
from markerseek.records.banks.arrays import read_arrays
from tests.unit.records.vantage_workspaces import CONNECTOR, ELEMENTS, write_workspace

FRAMES = np.random.default_rng(31).integers(-2000, 2000, (5, ELEMENTS, 60)).astype(np.int16)
STEPS = (-10.0, 5.0)


def read(path):
    return read_arrays(path, table=TableFormat(first_and_step_deg=STEPS))


def frames_of(bank):
    return np.stack([bank.frame(index).samples for index in range(len(bank.angles_deg))])


@pytest.mark.parametrize("repeats", [1, 3])
def test_the_receives_without_a_transmit_come_back(tmp_path, repeats):
    bank = read(write_workspace(tmp_path / "run.mat", FRAMES, repeats=repeats))
    np.testing.assert_array_equal(frames_of(bank), FRAMES)
    assert bank.angles_deg == (-10.0, -5.0, 0.0, 5.0, 10.0)
    assert (bank.facts.sampling_hz, bank.facts.sound_speed_m_s) == (40e6, 1500.0)
    assert bank.facts.pitch_m == pytest.approx(0.3e-3)
    assert {bank.frame(index).header.pulses for index in range(5)} == {repeats}


def test_without_events_all_receives_are_photoacoustic(tmp_path):
    def one_kind(workspace):
        """The first acquisition of each frame is as the second."""
        del workspace.file["Receive/sampleMode"]
        rows = workspace.file[workspace.file["RcvData"][()].flat[0]]
        rows[:, :, :60] = rows[:, :, 60:120]

    path = write_workspace(tmp_path / "run.mat", FRAMES, mixed=False, change=one_kind)
    bank = read(path)
    assert {bank.frame(index).header.pulses for index in range(5)} == {2}
    np.testing.assert_array_equal(frames_of(bank), FRAMES)


def test_samples_count_from_the_trigger(tmp_path):
    """A depth of 1.5 wavelengths at 5 MHz, to and fro, is 24 samples at 40 MHz; medians are before them."""
    bank = read(write_workspace(tmp_path / "run.mat", FRAMES, start_depth=1.5))
    assert bank.facts.first_sample_s == 24 / 40e6
    counts = frames_of(bank)
    np.testing.assert_array_equal(counts[:, :, :24], np.rint(np.median(FRAMES, axis=2, keepdims=True)).repeat(24, 2))
    np.testing.assert_array_equal(counts[:, :, 24:], FRAMES)


def replaced(field, value):
    def change(workspace):
        group, name = field.rsplit("/", 1)
        del workspace.file[field]
        if value is not None:
            workspace.value(workspace.file[group], name, value)

    return change


def loops(workspace):
    """Each start sample refers to the list of references that it stands in."""
    starts = workspace.file["Receive/startSample"]
    starts[...] = np.full(starts.shape, starts.ref, h5py.ref_dtype)


def refers_to_a_group(workspace):
    cell = workspace.file["RcvData"]
    cell[...] = np.full(cell.shape, workspace.file["Receive"].ref, h5py.ref_dtype)


def refers_to_nothing(workspace):
    number = workspace.file["Receive/framenum"].shape
    del workspace.file["Receive/framenum"]
    workspace.file["Receive"].create_dataset("framenum", number, h5py.ref_dtype)


def leads_elsewhere(workspace):
    del workspace.file["Trans"]
    workspace.file["Trans"] = h5py.ExternalLink("/etc/hostname", "/")


def emptied(field):
    """A cell of Octave without items."""

    def change(workspace):
        del workspace.file[field]
        workspace.file.create_group(field)

    return change


def huge(workspace):
    shape = (1000, 1 << 20)
    workspace.held.create_dataset("huge", shape, np.int16, chunks=(1, 1 << 20), compression="gzip")
    cell = workspace.file["RcvData"]
    cell[...] = np.full(cell.shape, workspace.held["huge"].ref, h5py.ref_dtype)


def every(field, value):
    def change(workspace):
        for reference in workspace.file[field][()].ravel():
            workspace.file[reference][...] = value

    return change


def with_field(name, value):
    """Each receive has this field."""

    def change(workspace):
        count = workspace.file["Receive/framenum"].size
        if name in workspace.file["Receive"]:
            del workspace.file[f"Receive/{name}"]
        fields = workspace.structures(workspace.file, "more", **{name: [value] * count})
        workspace.file.move(f"more/{name}", f"Receive/{name}")
        del workspace.file[fields.name]

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (replaced("Receive/startSample", None), "Receive.startSample is missing; save the whole workspace"),
        (replaced("Receive/framenum", 1.0), "Receive.framenum is there 1 times instead of 10"),
        (replaced("Trans/Connector", None), "Trans.Connector is missing; save Trans too"),
        (replaced("Trans/Connector", np.ones((ELEMENTS, 2))), "the probe switches its elements; use one aperture"),
        (replaced("Trans/Connector", np.arange(5.0, 13.0)[:, None]), "connects channels 5 to 12, and RcvData has 10"),
        (replaced("Trans/type", 1.0), "the array is not linear"),
        (replaced("TX/Apod", None), "an event names TX 1, and its Apod is missing; save TX too"),
        (replaced("TX/Apod", np.ones(ELEMENTS)), "an event names TX 2"),
        (every("Event/tx", 1.0), "each of its events has a transmit, and none is photoacoustic"),
        (every("Event/rcv", 99.0), "an event names receive 99 of 10"),
        (every("Receive/startSample", -3.0), "begins at sample -3"),
        (every("Receive/startSample", 0.5), "whole numbers are expected"),
        (every("Receive/startSample", np.nan), "not finite"),
        (every("Receive/endSample", 1e9), "one value is expected|a receive ends at sample"),
        (every("Receive/framenum", 77.0), "fill frames 77 to 77, and RcvData holds 5"),
        (every("Receive/bufnum", 2.0), "RcvData has 1 buffers, and the receives fill number 2"),
        (every("Receive/startDepth", 1e12), "µs after the trigger, at most 200 µs may be, .*; correct it"),
        (
            with_field("sampleMode", "NS200BWI"),
            "Receive.sampleMode is 'NS200BWI', whose samples are not equally spaced in",
        ),
        (with_field("aperture", 33.0), "Receive.aperture is 33: the probe switches its elements; acquire with a probe"),
        (emptied("RcvData"), "RcvData has 0 buffers"),
        (emptied("Receive/framenum"), "Receive.framenum is missing"),
        (emptied("Trans/Connector"), "Trans.Connector is missing; save Trans too"),
        (loops, "no MATLAB file|numbers are expected"),
        (refers_to_a_group, "RcvData is no dataset"),
        (refers_to_nothing, "Receive.framenum refers to nothing, or to no dataset"),
        (leads_elsewhere, "Trans is a link to another place"),
        (huge, "huge|bytes|fill frames|is expected"),
    ],
)
def test_what_cannot_be_read_is_refused_with_a_cure(tmp_path, change, message):
    with pytest.raises(RecordError, match=message):
        read(write_workspace(tmp_path / "run.mat", FRAMES, change=change))


def test_a_number_that_is_an_empty_cell_is_missing(tmp_path):
    path = write_workspace(tmp_path / "run.mat", FRAMES, change=emptied("Trans/spacingMm"))
    assert read(path).facts.pitch_m is None


def test_pairs_of_samples_are_refused(tmp_path):
    def pairs(workspace):
        for reference in workspace.file["Receive/sampleMode"][()].ravel():
            item = workspace.file[reference]
            item[...] = np.array([[ord(each)] for each in "BS100BW"], np.uint16)

    with pytest.raises(RecordError, match=r"Receive.sampleMode is 'BS100BW'.*acquire with sampleMode 'NS200BW'"):
        read(write_workspace(tmp_path / "run.mat", FRAMES, change=pairs))


def test_a_workspace_of_version_7_says_how_to_save_it(tmp_path):
    cell = np.empty((1, 1), object)
    cell[0, 0] = FRAMES
    savemat(tmp_path / "run.mat", {"RcvData": cell})
    with pytest.raises(RecordError, match=r"it is a Verasonics workspace; save it as HDF5: save\('run.mat', '-v7.3'\)"):
        read(tmp_path / "run.mat")


@pytest.mark.skipif(
    shutil.which("octave-cli") is None, reason="GNU Octave is missing; install it: apt-get install octave"
)
def test_octave_writes_the_same_workspace(tmp_path):
    """GNU Octave's own ``save -hdf5`` of cells and structures."""
    FRAMES.transpose(2, 1, 0).ravel(order="F").astype("<i2").tofile(tmp_path / "frames.bin")
    samples = FRAMES.shape[2]
    count = FRAMES.shape[0]
    (tmp_path / "save_it.m").write_text(
        f"""
        file = fopen('frames.bin'); frames = reshape(fread(file, Inf, 'int16=>int16'), {samples}, {ELEMENTS}, {count});
        data = int16(randi([-99, 99], {2 * samples}, 10, {count}));
        data({samples} + (1:{samples}), {list(CONNECTOR)}, :) = frames;
        RcvData = {{data}};
        for k = 1:{count}
          for kind = 1:2
            Receive(2 * k + kind - 2) = struct('startSample', {samples} * (kind - 1) + 1, ...
              'endSample', {samples} * kind, 'framenum', k, 'bufnum', 1, ...
              'decimSampleRate', 40, 'sampleMode', 'NS200BW', 'startDepth', 0);
            Event(2 * k + kind - 2) = struct('tx', 2 - kind, 'rcv', 2 * k + kind - 2);
          end
        end
        TX = struct('Apod', ones(1, {ELEMENTS}));
        Trans = struct('frequency', 5, 'spacingMm', 0.3, 'type', 0, 'Connector', {list(CONNECTOR)}');
        Resource.Parameters.speedOfSound = 1500;
        Resource.RcvBuffer = struct('lastFrame', {count});
        save -hdf5 run.mat RcvData Receive Event TX Trans Resource
        """
    )
    subprocess.run(["octave-cli", "--no-init-file", "save_it.m"], cwd=tmp_path, check=True, timeout=60)
    bank = read(tmp_path / "run.mat")
    np.testing.assert_array_equal(frames_of(bank), FRAMES)
    assert bank.facts.sampling_hz == 40e6
    assert bank.facts.pitch_m == pytest.approx(0.3e-3)


SCAN_DEG = np.arange(-20.0, 20.0, 1.6)


def scan_of(marker, other, *, energies):
    """Frames of a marker at 5 degrees and another absorber at -9, deeper, beside a pick-up that all frames have."""
    rng = np.random.default_rng(17)
    frames = rng.normal(0, 20, (len(SCAN_DEG), ELEMENTS, 400))
    for start, strength in ((10, 900 * np.ones_like(SCAN_DEG)), (150, marker * lobe(5.0)), (290, other * lobe(-9.0))):
        wave = np.cos(np.arange(24) * 1.2) * np.hanning(24)
        frames[:, :, start : start + 24] += (energies * strength)[:, None, None] * wave
    return np.rint(frames).astype(np.int16)


def lobe(at_deg):
    return np.exp(-(((SCAN_DEG - at_deg) / 2.5) ** 2))


def write_pairs(path, first, second):
    """A workspace without Event, whose frames have two acquisitions each."""
    both = np.concatenate([first, second], axis=2)

    def change(workspace):
        del workspace.file["Receive/sampleMode"]
        rows = workspace.file[workspace.file["RcvData"][()].flat[0]]
        for element, channel in enumerate(CONNECTOR):
            rows[:, channel - 1, : both.shape[2]] = both[:, element]

    return write_workspace(path, first, mixed=False, change=change)


def test_repeats_whose_energies_differ_are_averaged(tmp_path):
    rng = np.random.default_rng(2)
    pair = [scan_of(700, 350, energies=rng.uniform(0.7, 1.3, len(SCAN_DEG))) for _ in range(2)]
    bank = read_arrays(write_pairs(tmp_path / "run.mat", *pair), TableFormat(first_and_step_deg=(-20, 1.6)))
    np.testing.assert_array_equal(frames_of(bank), np.rint(np.mean(pair, axis=0)))


@pytest.mark.parametrize("second", [(100, 800), (0, 600), (300, 0)])
def test_acquisitions_at_two_wavelengths_are_not_averaged(tmp_path, second):
    """The second wavelength shows another absorber, or nothing of the first."""
    energies = np.random.default_rng(3).uniform(0.8, 1.2, (2, len(SCAN_DEG)))
    first = scan_of(700, 350 if second[1] else 900, energies=energies[0])
    path = write_pairs(tmp_path / "run.mat", first, scan_of(*second, energies=energies[1]))
    with pytest.raises(RecordError, match=r"2 acquisitions of a frame are no repeats.*Receive = Receive\(1:2:end\)"):
        read_arrays(path, TableFormat(first_and_step_deg=(-20, 1.6)))


@pytest.mark.parametrize("saved", [True, False])
def test_a_buffer_of_one_frame_holds_the_scan_in_its_acquisitions(tmp_path, saved):
    """Seven acquisitions, the first with a transmit; all but this one have an angle."""
    path = write_workspace(tmp_path / "run.mat", FRAMES[:1], repeats=6, last_saved=saved)
    with h5py.File(path) as file:
        rows = file[file["RcvData"][()].flat[0]][0]
    bank = read_arrays(path, TableFormat(first_and_step_deg=(-4.0, 2.0)))
    assert bank.angles_deg == (-4.0, -2.0, 0.0, 2.0, 4.0, 6.0)
    expected = rows[np.array(CONNECTOR) - 1, 60:420].reshape(ELEMENTS, 6, 60).transpose(1, 0, 2)
    np.testing.assert_array_equal(frames_of(bank), expected)


def test_the_lens_of_a_vantage_delays_the_sound(tmp_path):
    """Once: the light does not cross it. 5 wavelengths of 5 MHz are 1 µs, 40 samples."""

    def with_lens(workspace):
        workspace.value(workspace.file["Trans"], "lensCorrection", 5.0)

    frames = np.random.default_rng(3).integers(-500, 500, (12, 128, 400)).astype(np.int16)
    found = []
    for name, change in (("thin", None), ("thick", with_lens)):
        path = tmp_path / f"{name}.mat"
        connector = tuple(range(1, frames.shape[1] + 1))
        write_workspace(path, frames, connector=connector, spacing_mm=0.43, last_saved=True, change=change)
        bank = read_arrays(path, table=TableFormat(first_and_step_deg=(7.0, 1.0)))
        found.append(bank.frame(6).samples)
    np.testing.assert_array_equal(found[1], found[0][:, 40:])
