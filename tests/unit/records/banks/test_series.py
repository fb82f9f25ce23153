"""Export of image series: their order and times, tables, and exports that fail."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import pytest
import SimpleITK as sitk  # noqa: N813 - the name that its users give it

from markerseek.core import PaImage, RecordError
from markerseek.records.banks import FrameBank, IntensityBank, read_bank, series_of, write_bank, write_sequence
from tests.unit.records.banks.exported import ANGLES, DEPTH, FACTS, LATERAL, SERIES, images


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
    series = series_of(frames((30.5, 10.0, 20.0), facts=replace(FACTS, clock_zero_unix_s=1.7e9)))
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
    series = series_of(frames(started_s, facts=replace(FACTS, clock_zero_unix_s=1.7e9)))
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
