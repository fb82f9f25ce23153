"""Exports, read back by other people's libraries: SimpleITK for the sequence, Foxglove's mcap for the log."""

from __future__ import annotations

import math

import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813 - the name that its users give it
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from markerseek.core import PaImage, RecordError
from markerseek.records.banks import read_bank
from markerseek.records.exports import write_intensities, write_mcap, write_sequence
from markerseek.records.exports.sequence import image_to_probe, probe_to_probe_home

ANGLES = (-30.0, 0.25, 12.5)
LATERAL = np.linspace(-4e-3, 4e-3, 9)
DEPTH = np.linspace(5e-3, 8e-3, 13)


def images():
    rng = np.random.default_rng(5)
    return [PaImage(envelope=rng.random((13, 9)).astype(np.float32), lateral_m=LATERAL, depth_m=DEPTH) for _ in ANGLES]


@pytest.fixture
def sequence(tmp_path):
    path = tmp_path / "a.igs.mha"
    write_sequence(path, iter(images()), angles_deg=ANGLES, face_radius_m=10e-3)
    return sitk.ReadImage(str(path))


def matrix(image, key):
    return np.array(image.GetMetaData(key).split(), dtype=np.float64).reshape(4, 4)


def test_simpleitk_reads_equal_pixels(sequence):
    np.testing.assert_array_equal(sitk.GetArrayFromImage(sequence), np.stack([each.envelope for each in images()]))
    np.testing.assert_allclose(sequence.GetSpacing(), (1.0, 0.25, 1.0))


@pytest.mark.parametrize("number", range(3))
def test_the_transforms_take_a_pixel_to_where_it_is(sequence, number):
    """The marker's place as conventions.md has it: (ρ sin θ, y, ρ cos θ), here of column 6, row 4."""
    prefix = f"Seq_Frame{number:04d}_"
    to_home = matrix(sequence, f"{prefix}ProbeToProbeHomeTransform")
    to_probe = matrix(sequence, f"{prefix}ImageToProbeTransform")
    radius_mm = 10.0 + 1e3 * DEPTH[4]
    angle = math.radians(ANGLES[number])
    expected = (radius_mm * math.sin(angle), 1e3 * LATERAL[6], radius_mm * math.cos(angle), 1)
    np.testing.assert_allclose(to_home @ to_probe @ (6, 4, 0, 1), expected, atol=1e-9)
    for transform in ("ProbeToProbeHome", "ImageToProbe"):
        assert sequence.GetMetaData(f"{prefix}{transform}TransformStatus") == "OK"
    assert sequence.GetMetaData(f"{prefix}ImageStatus") == "OK"
    assert float(sequence.GetMetaData(f"{prefix}angle_deg")) == ANGLES[number]


@pytest.mark.parametrize("angle_deg", [-90.0, -3.0, 0.0, 45.0])
def test_rotations_are_proper_and_images_right_handed(angle_deg):
    rotation = probe_to_probe_home(angle_deg)[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert np.linalg.det(image_to_probe(images()[0], face_radius_m=0.0)[:3, :3]) > 0


def test_what_is_not_known_of_the_probe_is_left_out(tmp_path):
    write_sequence(tmp_path / "a.igs.mha", iter(images()), angles_deg=ANGLES, face_radius_m=None)
    image = sitk.ReadImage(str(tmp_path / "a.igs.mha"))
    assert image.HasMetaDataKey("Seq_Frame0000_ProbeToProbeHomeTransform")
    assert not image.HasMetaDataKey("Seq_Frame0000_ImageToProbeTransform")


def test_lines_are_as_long_as_plus_can_read(tmp_path):
    """PLUS reads lines of at most 999 bytes, and the kind of each axis."""
    write_sequence(tmp_path / "a.igs.mha", iter(images()), angles_deg=ANGLES, face_radius_m=10e-3)
    head = (tmp_path / "a.igs.mha").read_bytes().split(b"ElementDataFile = LOCAL\n")[0].decode("ascii")
    assert head.startswith("ObjectType = Image\nNDims = 3\n")
    assert "\nKinds = domain domain list\n" in head
    assert "\nUltrasoundImageOrientation = MF\n" in head
    assert max(map(len, head.splitlines())) < 999


def messages(path):
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [(channel.topic, schema.name, each) for schema, channel, _, each in reader.iter_decoded_messages()]


def test_mcap_is_read_by_a_second_library(tmp_path):
    write_mcap(tmp_path / "a.mcap", iter(images()), angles_deg=ANGLES, intensities=(1.0, 2.0, 3.0))
    heard = messages(tmp_path / "a.mcap")
    shown = [each for topic, kind, each in heard if (topic, kind) == ("/TRUS/pa/image", "sensor_msgs/msg/Image")]
    assert len(shown) == 3
    for expected, image in zip(images(), shown, strict=True):
        assert (image.height, image.width, image.encoding, image.step) == (13, 9, "32FC1", 36)
        pixels = np.frombuffer(bytes(image.data), "<f4").reshape(13, 9)
        np.testing.assert_array_equal(pixels, expected.envelope)
    joints = [each for topic, _, each in heard if topic == "/TRUS/measured_js"]
    assert [each.name for each in joints] == [["trus_roll"]] * 3
    np.testing.assert_allclose([each.position[0] for each in joints], np.radians(ANGLES))
    assert [each.header.stamp.sec for each in joints] == [0, 1, 2]
    assert [each.data for topic, _, each in heard if topic == "/pa_search/intensity"] == [1.0, 2.0, 3.0]


def test_mcap_of_intensities_alone(tmp_path):
    write_mcap(tmp_path / "a.mcap", None, angles_deg=ANGLES, intensities=(1.0, 2.0, 3.0))
    assert {topic for topic, _, _ in messages(tmp_path / "a.mcap")} == {"/TRUS/measured_js", "/pa_search/intensity"}
    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]


def test_a_table_is_read_back(tmp_path):
    write_intensities(tmp_path / "a.csv", angles_deg=ANGLES, intensities=(0.1, 1 / 3, 2e-17))
    bank = read_bank(tmp_path / "a.csv")
    assert (bank.angles_deg, bank.intensities) == (ANGLES, (0.1, 1 / 3, 2e-17))


def other_shape():
    first, second, _ = images()
    return [first, PaImage(envelope=second.envelope[:-1], lateral_m=LATERAL, depth_m=DEPTH[:-1])]


def test_nothing_is_left_of_an_export_that_fails(tmp_path):
    with pytest.raises(RecordError, match="keep one probe"):
        write_sequence(tmp_path / "a.igs.mha", iter(other_shape()), angles_deg=ANGLES[:2], face_radius_m=None)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    for place in ("file", "file/inside"):
        with pytest.raises(RecordError, match=r"there is a file already|cannot be written"):
            write_sequence(tmp_path / place, iter(images()), angles_deg=ANGLES, face_radius_m=None)
        with pytest.raises(RecordError, match=r"there is a file already|cannot be written"):
            write_mcap(tmp_path / place, iter(images()), angles_deg=ANGLES, intensities=())
