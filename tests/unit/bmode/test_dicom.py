"""B-mode images as machines write them in DICOM: palettes, regions, order and size of pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from pydicom.dataset import Dataset

from markerseek.bmode import ImageSeries, read_images
from markerseek.core import RecordError
from tests.notes import noted
from tests.tip_images import dicom, eleven_tip_images, region

Grey = npt.NDArray[np.uint8]


@pytest.mark.parametrize("entry", [np.uint8, np.uint16])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_palette_is_applied(tmp_path: Path, entry: type[np.uint8 | np.uint16], seed: int) -> None:
    """A palette that is not monotonic: the brightest number may be black."""
    number_of = np.random.default_rng(seed).permutation(256).astype(np.uint8)
    palette = np.empty(256, entry)
    palette[number_of] = np.arange(256) * (1 if entry is np.uint8 else 257)
    tags: dict[str, object] = {"PhotometricInterpretation": "PALETTE COLOR"}
    for colour in ("Red", "Green", "Blue"):
        tags[f"{colour}PaletteColorLookupTableDescriptor"] = [256, 0, 8 * palette.itemsize]
        tags[f"{colour}PaletteColorLookupTableData"] = palette.tobytes()
    images = eleven_tip_images()[:2]
    series = read_images(dicom(tmp_path / "scan.dcm", number_of[images], **tags))
    # Where a grey value of 255 is not reached, 16 bits are scaled to it.
    scale = 1 if entry is np.uint8 else 255 / images.max()
    for image, expected in zip(series.images, images, strict=True):
        np.testing.assert_allclose(image, np.rint(expected * scale), atol=1)


def test_a_coloured_palette_becomes_grey(tmp_path: Path) -> None:
    """Sepia: the brightest colour counts, as in images of three colours."""
    grey = np.arange(256, dtype=np.uint8)
    tags: dict[str, object] = {"PhotometricInterpretation": "PALETTE COLOR"}
    for colour, share in (("Red", 1.0), ("Green", 0.8), ("Blue", 0.5)):
        tags[f"{colour}PaletteColorLookupTableDescriptor"] = [256, 0, 8]
        tags[f"{colour}PaletteColorLookupTableData"] = (grey * share).astype(np.uint8).tobytes()
    series = read_images(dicom(tmp_path / "scan.dcm", eleven_tip_images()[:1], **tags))
    np.testing.assert_array_equal(series.images[0], eleven_tip_images()[0])


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_monochrome1_is_inverted_alike_in_all_files(tmp_path: Path, bits: int) -> None:
    """Files of a folder have different maxima; equal tissue stays equally bright."""
    kind, factor = (np.uint8, 1) if bits == 8 else (np.uint16, (2**bits - 1) // 255)
    images = [np.clip(eleven_tip_images()[0], 0, most) for most in (255, 120, 60)]
    tags = {"PhotometricInterpretation": "MONOCHROME1", "BitsStored": bits, "HighBit": bits - 1}
    (tmp_path / "scan").mkdir()
    for number, image in enumerate(images):
        stored = (2**bits - 1 - image.astype(np.int64) * factor).astype(kind)
        dicom(tmp_path / "scan" / f"{number}.dcm", stored[None], **tags)
    found = read_images(tmp_path / "scan").images
    scale = 1 if bits == 8 else 255 / images[0].max()
    for image, expected in zip(found, images, strict=True):
        np.testing.assert_allclose(image, expected * scale, atol=1)


def size_mm(path: Path, **options: tuple[int, int, int, int]) -> tuple[float, float] | None:
    found = read_images(path, **options).pixel_m
    return None if found is None else (round(1e3 * found[0], 6), round(1e3 * found[1], 6))


def test_a_region_outweighs_the_spacing_and_other_kinds_of_regions(tmp_path: Path) -> None:
    images = np.zeros((1, 60, 100), np.uint8)
    image = region((10, 10), (49, 49), 0.2)
    m_mode = region((10, 50), (49, 99), 3.0, units=4, spatial_format=2)
    graphic = region((0, 0), (9, 99), 5.0, spatial_format=5)
    colour = region((20, 20), (30, 30), 0.2)
    for regions, tags, expected in (
        ([image], {"PixelSpacing": [1, 1]}, 0.2),
        ([m_mode, graphic, image, colour], {}, 0.2),
        ([m_mode, graphic], {"PixelSpacing": [0.3, 0.3]}, 0.3),
        ([], {"PixelSpacing": [0.3, 0.3]}, 0.3),
    ):
        path = dicom(tmp_path / "scan.dcm", images, SequenceOfUltrasoundRegions=regions, **tags)
        assert size_mm(path) == (expected, expected)
    assert size_mm(dicom(tmp_path / "scan.dcm", images, SequenceOfUltrasoundRegions=[m_mode])) is None


def test_a_rectangle_in_no_region_or_in_two_that_differ_decides_nothing(tmp_path: Path) -> None:
    images = np.zeros((1, 60, 100), np.uint8)
    regions = [region((0, 0), (59, 49), 0.2), region((0, 50), (59, 99), 0.4), region((10, 10), (20, 20), 0.1)]
    path = dicom(tmp_path / "scan.dcm", images, SequenceOfUltrasoundRegions=regions)
    assert size_mm(path, roi=(30, 60, 10, 10)) == (0.4, 0.4)
    assert size_mm(path, roi=(30, 10, 10, 10)) == (0.2, 0.2)
    for roi in ((30, 45, 10, 10), (12, 12, 5, 5)):
        with pytest.raises(RecordError, match="image regions of several scales"):
            size_mm(path, roi=roi)


def ramp(count: int) -> Grey:
    """Images that differ in all pixels, the first the darkest."""
    return np.stack([np.full((20, 30), 10 + 20 * number, np.uint8) for number in range(count)])


def levels(series: ImageSeries) -> list[int]:
    return [int(image[0, 0]) for image in series.images]


@pytest.mark.parametrize("name", ["1.2.840.{}.dcm", "{}.dcm"])
def test_files_are_in_the_order_of_their_instance_numbers(tmp_path: Path, name: str) -> None:
    """The names, as of an archive, say nothing of it."""
    for number, other in enumerate((77, 12, 903, 41)):
        dicom(tmp_path / name.format(other), ramp(4)[number][None], InstanceNumber=str(5 + number))
    with noted("in the order of their InstanceNumber, which is not that of their names; the"):
        assert levels(read_images(tmp_path)) == [10, 30, 50, 70]


def test_missing_instance_numbers_are_named(tmp_path: Path) -> None:
    for number, other in ((1, 9), (2, 3), (4, 8)):
        dicom(tmp_path / f"{other}.dcm", ramp(4)[number - 1][None], InstanceNumber=str(number))
    with noted("not that of their names; 3 are missing"):
        assert levels(read_images(tmp_path)) == [10, 30, 70]


@pytest.mark.parametrize("instances", [("1", "2", "3"), ("1", "1", "1"), (None, None, None), ("1", None, "3")])
def test_instance_numbers_that_say_nothing_else_leave_the_order_of_the_names(
    tmp_path: Path, instances: tuple[str | None, ...]
) -> None:
    for number, instance in enumerate(instances):
        tags = {} if instance is None else {"InstanceNumber": instance}
        dicom(tmp_path / f"frame{number + 8}.dcm", ramp(3)[number][None], **tags)
    assert levels(read_images(tmp_path)) == [10, 30, 50]


def test_names_that_are_angles_outweigh_instance_numbers(tmp_path: Path) -> None:
    for number, angle_deg in enumerate((4.5, -2.0, 1.0)):
        dicom(tmp_path / f"angle_{angle_deg}deg.dcm", ramp(3)[number][None], InstanceNumber=str(number))
    assert set(read_images(tmp_path).names) == {"angle_4.5deg.dcm", "angle_-2.0deg.dcm", "angle_1.0deg.dcm"}


def groups(name: str, *values: Dataset) -> list[Dataset]:
    """Functional groups of some frames: each has a sequence of this name with one item."""
    found = []
    for value in values:
        group = Dataset()
        setattr(group, name, [value])
        found.append(group)
    return found


def item(**tags: object) -> Dataset:
    made = Dataset()
    for name, value in tags.items():
        setattr(made, name, value)
    return made


def test_frames_are_in_the_order_of_their_stack(tmp_path: Path) -> None:
    order = (3, 1, 4, 2)
    places = groups("FrameContentSequence", *(item(InStackPositionNumber=number) for number in order))
    stored = np.stack([ramp(4)[number - 1] for number in order])
    path = dicom(tmp_path / "scan.dcm", stored, PerFrameFunctionalGroupsSequence=places)
    assert levels(read_images(path)) == [10, 30, 50, 70]
    places[1].FrameContentSequence[0].InStackPositionNumber = 4
    path = dicom(tmp_path / "scan.dcm", stored, PerFrameFunctionalGroupsSequence=places)
    with pytest.raises(RecordError, match="InStackPositionNumber is 4 of several frames: it holds several stacks"):
        read_images(path)


def test_the_size_of_a_pixel_in_functional_groups_is_read(tmp_path: Path) -> None:
    size = item(PixelSpacing=["0.21", "0.34"])
    path = dicom(tmp_path / "scan.dcm", ramp(3), SharedFunctionalGroupsSequence=groups("PixelMeasuresSequence", size))
    assert size_mm(path) == (0.21, 0.34)
    each = groups("PixelMeasuresSequence", size, size, item(PixelSpacing=["0.3", "0.3"]))
    path = dicom(tmp_path / "scan.dcm", ramp(3), PerFrameFunctionalGroupsSequence=each)
    with pytest.raises(RecordError, match="PixelSpacing differs from frame to frame"):
        read_images(path)
    path = dicom(tmp_path / "scan.dcm", ramp(3), PerFrameFunctionalGroupsSequence=each[:2])
    with pytest.raises(RecordError, match="PixelSpacing is stated for some of its frames only"):
        read_images(path)


def test_rescaled_grey_values_can_be_compared_from_file_to_file(tmp_path: Path) -> None:
    for number, slope in enumerate((0.5, 1.0, 2.0)):
        stored = np.rint((ramp(3)[number] - 4.0) / slope).astype(np.uint8)
        dicom(tmp_path / f"{number}.dcm", stored[None], RescaleSlope=str(slope), RescaleIntercept="4")
    assert levels(read_images(tmp_path)) == [10, 30, 50]
    slopes = groups(
        "PixelValueTransformationSequence", *(item(RescaleSlope=slope, RescaleIntercept=0) for slope in (1, 3, 0.5))
    )
    path = dicom(tmp_path / "frames.dcm", ramp(3), PerFrameFunctionalGroupsSequence=slopes)
    assert levels(read_images(path)) == [10, 90, 25]
    lut = item(LUTDescriptor=[256, 0, 8], ModalityLUTType="US", LUTData=bytes(256))
    with pytest.raises(RecordError, match="it has a ModalityLUTSequence, which is not read"):
        read_images(dicom(tmp_path / "frames.dcm", ramp(3), ModalityLUTSequence=[lut]))
