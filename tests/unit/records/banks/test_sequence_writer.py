"""Sequences for 3D Slicer and PLUS, read back by SimpleITK: order and times, transforms, exports that fail."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813 - the name that its users give it
from msgspec import structs

from markerseek.core import PaImage, RecordError
from markerseek.records.banks import FrameBank, IntensityBank, read_bank, series_of, write_bank, write_sequence
from markerseek.records.banks.sequence_writer import IMAGE_ORIENTATION, image_to_probe
from tests.unit.records.banks.exported import ANGLES, DEPTH, FACTS, LATERAL, SERIES, UNPLACED, images, place_mm


@dataclass(frozen=True, kw_only=True)
class Frames(FrameBank):
    """A bank whose frames are never read."""

    def frame(self, index):
        raise NotImplementedError

    dark_frame = frame


def frames(started_s, **more):
    return Frames(angles_deg=ANGLES, intensities=(1.0, 2.0, 3.0), started_s=started_s, **more)


def test_a_series_is_in_the_order_of_time():
    series = series_of(frames((30.5, 10.0, 20.0)))
    assert (series.order, series.times_s, series.clock) == ((1, 2, 0), (10.0, 20.0, 30.5), "rig")
    assert series.angles_deg == (0.25, 12.5, -30.0)


def test_where_the_clock_began_gives_the_time_of_day(tmp_path):
    series = series_of(frames((30.5, 10.0, 20.0), facts=structs.replace(FACTS, clock_zero_unix_s=1.7e9)))
    assert (series.times_s, series.clock) == ((1.7e9 + 10, 1.7e9 + 20, 1.7e9 + 30.5), "unix")
    write_sequence(tmp_path / "a.igs.mha", iter(images()), series=series)
    image = sitk.ReadImage(str(tmp_path / "a.igs.mha"))
    assert [float(image.GetMetaData(f"Seq_Frame{number:04d}_Timestamp")) for number in range(3)] == [0, 10, 20.5]
    assert float(image.GetMetaData("markerseek_first_time_s")) == 1.7e9 + 10
    assert image.GetMetaData("markerseek_times").startswith("seconds since 1970-01-01")


@pytest.mark.parametrize(
    "started_s",
    [(), (0.0, 0.0, 0.0), (1.0, math.nan, 3.0), (5.0, 5.0, 6.0), (0.0, 1e6, 1e6 + 0.5), (-1.0, 2.0, 3.0)],
    ids=["none", "unknown", "not of all", "doubled", "too close for Slicer", "negative"],
)
def test_uninformative_times_are_replaced_by_numbers(started_s):
    series = series_of(frames(started_s, facts=structs.replace(FACTS, clock_zero_unix_s=1.7e9)))
    assert (series.order, series.times_s, series.clock) == ((0, 1, 2), (0.0, 1.0, 2.0), "none")


def test_a_table_is_read_back(tmp_path):
    write_bank(IntensityBank(angles_deg=ANGLES, intensities=(0.1, 1 / 3, 2e-17)), tmp_path / "a.csv")
    bank = read_bank(tmp_path / "a.csv")
    assert (bank.angles_deg, bank.intensities) == (ANGLES, (0.1, 1 / 3, 2e-17))


def other_shape():
    first, second, _ = images()
    return [first, PaImage(envelope=second.envelope[:-1], lateral_m=LATERAL, depth_m=DEPTH[:-1])]


def test_nothing_is_left_of_an_export_that_fails(tmp_path):
    with pytest.raises(RecordError, match="keep one probe"):
        write_sequence(tmp_path / "a.igs.mha", iter(other_shape()), series=SERIES)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    for place in ("file", "file/inside"):
        with pytest.raises(RecordError, match=r"there is a file already|cannot be written"):
            write_sequence(tmp_path / place, iter(images()), series=SERIES)


@pytest.fixture
def sequence(tmp_path):
    path = tmp_path / "a.igs.mha"
    write_sequence(path, iter(images()), series=SERIES)
    return sitk.ReadImage(str(path))


def matrix(image, key):
    return np.array(image.GetMetaData(key).split(), dtype=np.float64).reshape(4, 4)


@pytest.mark.parametrize("number", range(3))
def test_spacing_and_transforms_together_take_a_pixel_to_where_it_is(sequence, number):
    """Slicer applies the file's spacing and then the transforms, so the one must not repeat what the others say."""
    prefix = f"Seq_Frame{number:04d}_"
    to_home, to_probe = (matrix(sequence, f"{prefix}{name}Transform") for name in ("ProbeToProbeHome", "ImageToProbe"))
    pixel = (*sequence.TransformIndexToPhysicalPoint((6, 4, 0)), 1)
    np.testing.assert_allclose((to_home @ to_probe @ pixel)[:3], place_mm(number, 6, 4), atol=1e-9)
    for transform in ("ProbeToProbeHome", "ImageToProbe"):
        assert sequence.GetMetaData(f"{prefix}{transform}TransformStatus") == "OK"
    assert sequence.GetMetaData(f"{prefix}ImageStatus") == "OK"
    assert float(sequence.GetMetaData(f"{prefix}angle_deg")) == ANGLES[number]


def test_columns_run_towards_the_last_element_and_rows_away_from_the_array():
    """PLUS: X to the marked side, Y far, Z their product; MF: columns along X, rows along Y."""
    assert IMAGE_ORIENTATION == "MF"
    image = image_to_probe(images()[0].geometry, face_radius_m=10e-3)
    np.testing.assert_allclose(image @ (0, 0, 0, 1), (0, -4, 15, 1))
    np.testing.assert_allclose(image @ (8, 12, 0, 1), (0, 4, 18, 1))
    assert np.linalg.det(image[:3, :3]) > 0


def test_what_is_not_known_of_the_probe_is_left_out(tmp_path):
    write_sequence(tmp_path / "a.igs.mha", iter(images()), series=UNPLACED)
    image = sitk.ReadImage(str(tmp_path / "a.igs.mha"))
    assert image.HasMetaDataKey("Seq_Frame0000_ProbeToProbeHomeTransform")
    assert not image.HasMetaDataKey("Seq_Frame0000_ImageToProbeTransform")
    for name in ("description", "probe", "simulated", "reference_angle_deg", "face_radius_m"):
        assert not image.HasMetaDataKey(f"markerseek_{name}")


def test_known_facts_are_in_the_header(sequence):
    said = {
        key.removeprefix("markerseek_"): sequence.GetMetaData(key)
        for key in sequence.GetMetaDataKeys()
        if key.startswith("markerseek_")
    }
    expected = {
        "description": "a phantom",
        "simulated": "true",
        "probe": "BPL9-5/55",
        "face_radius_m": "0.01",
        "reference_angle_deg": "1.5",
        "times": "seconds on the clock of the rig",
        "first_time_s": "35.25",
        "pixels": "envelope in ADC counts",
    }
    assert said.items() >= expected.items()
    numbers = [
        float(said[f"{name}_m"]) for name in ("first_lateral", "first_depth", "lateral_spacing", "depth_spacing")
    ]
    np.testing.assert_allclose(numbers, (-4e-3, 5e-3, 1e-3, 0.25e-3))


@pytest.mark.parametrize(
    "description",
    ["one\nElementDataFile = LOCAL\nDimSize = 1 1 1", "µm\x1b[2J\u2028näh\r\n\x00", "long " * 1000, "\n", "\udcff"],
    ids=["fields", "signs", "long", "empty", "no text"],
)
def test_a_description_stays_one_line_of_ascii(tmp_path, description):
    """PLUS and Slicer read lines of at most 999 bytes."""
    path = tmp_path / "a.igs.mha"
    write_sequence(path, iter(images()), series=replace(SERIES, facts=structs.replace(FACTS, description=description)))
    image = sitk.ReadImage(str(path))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(image), np.stack([each.envelope for each in images()]))
    head, data = path.read_bytes().split(b"\nElementDataFile = LOCAL\n")
    assert len(data) == 3 * 13 * 9 * 4
    assert head.startswith(b"ObjectType = Image\nNDims = 3\n")
    assert b"\nKinds = domain domain list\n" in head
    assert b"\nUltrasoundImageOrientation = MF\n" in head
    assert all(len(line) < 998 and line.decode("ascii").isprintable() for line in head.split(b"\n"))
