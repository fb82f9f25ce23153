"""Exports, read back by other people's libraries: SimpleITK for the sequence, Foxglove's mcap for the log, SciPy."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813 - the name that its users give it
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError, PaImage, RecordError
from markerseek.records.banks import BankFacts, FrameBank, IntensityBank, read_bank
from markerseek.records.exports import Series, series_of, write_intensities, write_mcap, write_sequence
from markerseek.records.exports.frames import (
    IMAGE_ORIENTATION,
    TRANSDUCER_AXES,
    image_to_probe,
    image_to_transducer,
    probe_to_probe_home,
)

ANGLES = (-30.0, 0.25, 12.5)
TIMES = (35.25, 46.5, 1000.0)
LATERAL = np.linspace(-4e-3, 4e-3, 9)
DEPTH = np.linspace(5e-3, 8e-3, 13)
FACTS = BankFacts(
    description="a phantom", probe="BPL9-5/55", face_radius_m=10e-3, reference_angle_deg=1.5, simulated=True
)
SERIES = Series(
    angles_deg=ANGLES, times_s=TIMES, clock="rig", order=(0, 1, 2), intensities=(1.0, 2.0, 3.0), facts=FACTS
)
UNPLACED = replace(SERIES, facts=BankFacts())


def images():
    rng = np.random.default_rng(5)
    return [PaImage(envelope=rng.random((13, 9)).astype(np.float32), lateral_m=LATERAL, depth_m=DEPTH) for _ in ANGLES]


def place_mm(number, column, row):
    """The place of a pixel as conventions.md has it: (ρ sin θ, y, ρ cos θ)."""
    radius_mm, angle = 10.0 + 1e3 * DEPTH[row], math.radians(ANGLES[number])
    return radius_mm * math.sin(angle), 1e3 * LATERAL[column], radius_mm * math.cos(angle)


@pytest.fixture
def sequence(tmp_path):
    path = tmp_path / "a.igs.mha"
    write_sequence(path, iter(images()), series=SERIES)
    return sitk.ReadImage(str(path))


def matrix(image, key):
    return np.array(image.GetMetaData(key).split(), dtype=np.float64).reshape(4, 4)


def test_simpleitk_reads_equal_pixels(sequence):
    np.testing.assert_array_equal(sitk.GetArrayFromImage(sequence), np.stack([each.envelope for each in images()]))


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


@pytest.mark.parametrize("angle_deg", [-90.0, -3.0, 0.0, 45.0])
def test_rotations_are_those_of_scipy_and_images_right_handed(angle_deg):
    expected = Rotation.from_euler("y", angle_deg, degrees=True).as_matrix()
    np.testing.assert_allclose(probe_to_probe_home(angle_deg)[:3, :3], expected, atol=1e-12)
    assert np.linalg.det(image_to_probe(images()[0], face_radius_m=0.0)[:3, :3]) > 0


def test_transducer_x_is_the_array_towards_its_last_element_and_y_is_far():
    """PLUS: X to the marked side, Y far, Z their product; MF: columns along X, rows along Y."""
    axes = np.array(TRANSDUCER_AXES)
    np.testing.assert_array_equal(axes @ (1, 0, 0), (0, 1, 0))
    np.testing.assert_array_equal(axes @ (0, 1, 0), (0, 0, 1))
    np.testing.assert_array_equal(axes[:, 2], np.cross(axes[:, 0], axes[:, 1]))
    assert IMAGE_ORIENTATION == "MF"
    image = image_to_transducer(images()[0])
    np.testing.assert_allclose(image @ (0, 0, 0, 1), (-4, 5, 0, 1))
    np.testing.assert_allclose(image @ (8, 12, 0, 1), (4, 8, 0, 1))


def test_what_is_not_known_of_the_probe_is_left_out(tmp_path):
    write_sequence(tmp_path / "a.igs.mha", iter(images()), series=UNPLACED)
    image = sitk.ReadImage(str(tmp_path / "a.igs.mha"))
    assert image.HasMetaDataKey("Seq_Frame0000_ProbeToProbeHomeTransform")
    assert not image.HasMetaDataKey("Seq_Frame0000_ImageToProbeTransform")
    for name in ("description", "probe", "simulated", "reference_angle_deg", "face_radius_m"):
        assert not image.HasMetaDataKey(f"markerseek_{name}")


def test_what_is_known_stands_in_the_header(sequence):
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


def test_times_count_from_the_first_as_slicer_tells_them_apart(sequence):
    """SlicerIGSIO writes a timestamp with six digits, and keeps one frame of each that it then sees."""
    stamps = [float(sequence.GetMetaData(f"Seq_Frame{number:04d}_Timestamp")) for number in range(3)]
    np.testing.assert_allclose(stamps, (0, 11.25, 964.75))


@pytest.mark.parametrize(
    "description",
    ["one\nElementDataFile = LOCAL\nDimSize = 1 1 1", "µm\x1b[2J\u2028näh\r\n\x00", "long " * 1000, "\n", "\udcff"],
    ids=["fields", "signs", "long", "empty", "no text"],
)
def test_a_description_stays_one_line_of_ascii(tmp_path, description):
    """PLUS and Slicer read lines of at most 999 bytes."""
    path = tmp_path / "a.igs.mha"
    write_sequence(path, iter(images()), series=replace(SERIES, facts=replace(FACTS, description=description)))
    image = sitk.ReadImage(str(path))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(image), np.stack([each.envelope for each in images()]))
    head, data = path.read_bytes().split(b"\nElementDataFile = LOCAL\n")
    assert len(data) == 3 * 13 * 9 * 4
    assert head.startswith(b"ObjectType = Image\nNDims = 3\n")
    assert b"\nKinds = domain domain list\n" in head
    assert b"\nUltrasoundImageOrientation = MF\n" in head
    assert all(len(line) < 998 and line.decode("ascii").isprintable() for line in head.split(b"\n"))


def messages(path):
    """Topic, kind, time and message, in the order of the file."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [
            (channel.topic, schema.name, message.log_time, each)
            for schema, channel, message, each in reader.iter_decoded_messages(log_time_order=False)
        ]


def on_topic(heard, topic):
    return [each for name, _, _, each in heard if name == topic]


@pytest.fixture
def heard(tmp_path):
    write_mcap(tmp_path / "a.mcap", iter(images()), series=SERIES, brightest=0.9)
    return messages(tmp_path / "a.mcap")


def test_mcap_has_the_topics_of_a_running_rig(heard):
    assert {topic: kind for topic, kind, _, _ in heard} == {
        "/TRUS/measured_js": "sensor_msgs/msg/JointState",
        "/TRUS/pa/image": "sensor_msgs/msg/Image",
        "/TRUS/pa/envelope": "sensor_msgs/msg/Image",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/pa_search/bank": "std_msgs/msg/String",
        "/pa_search/sample": "std_msgs/msg/String",
        "/pa_search/intensity": "std_msgs/msg/Float64",
    }
    joints = on_topic(heard, "/TRUS/measured_js")
    assert [(each.name, each.header.frame_id) for each in joints] == [(["trus_roll"], "")] * 3
    np.testing.assert_allclose([each.position[0] for each in joints], np.radians(ANGLES))


def test_intensities_are_there_for_plots_and_for_programs(heard):
    assert [each.data for each in on_topic(heard, "/pa_search/intensity")] == [1.0, 2.0, 3.0]
    assert [json.loads(each.data) for each in on_topic(heard, "/pa_search/sample")] == [
        {"angle_deg": angle_deg, "intensity": intensity, "time_s": time_s}
        for angle_deg, intensity, time_s in zip(ANGLES, (1.0, 2.0, 3.0), TIMES, strict=True)
    ]


def test_pulses_are_told_where_they_are_known(tmp_path):
    write_mcap(tmp_path / "a.mcap", None, series=replace(SERIES, pulses=(64, 64, 12)))
    told = [json.loads(each.data)["pulses"] for each in on_topic(messages(tmp_path / "a.mcap"), "/pa_search/sample")]
    assert told == [64, 64, 12]


def test_the_envelope_is_exact(heard):
    for expected, image in zip(images(), on_topic(heard, "/TRUS/pa/envelope"), strict=True):
        assert (image.height, image.width, image.encoding, image.step) == (13, 9, "32FC1", 36)
        np.testing.assert_array_equal(np.frombuffer(bytes(image.data), "<f4").reshape(13, 9), expected.envelope)


def test_a_picture_tells_the_envelope_to_half_a_step(heard):
    """By the formula of the module, and the numbers that the file says."""
    bank = json.loads(on_topic(heard, "/pa_search/bank")[0].data)
    white, range_db = bank["picture_white"], bank["picture_range_db"]
    assert white == 0.9
    shades = set()
    for expected, image in zip(images(), on_topic(heard, "/TRUS/pa/image"), strict=True):
        assert (image.height, image.width, image.encoding, image.step) == (13, 9, "mono8", 9)
        assert image.header.frame_id == "trus_image"
        shade = np.frombuffer(bytes(image.data), np.uint8).reshape(13, 9).astype(float)
        told = white * 10 ** ((shade / 255 - 1) * range_db / 20)
        inside = (expected.envelope < white) & (expected.envelope > white * 10 ** (-range_db / 20))
        off_db = 20 * np.log10(told[inside] / expected.envelope[inside])
        assert np.abs(off_db).max() <= range_db / 255 / 2 + 1e-5
        assert (shade[expected.envelope >= white] == 255).all()
        assert (shade[expected.envelope <= white * 10 ** (-range_db / 20)] == 0).all()
        shades |= set(shade.ravel())
    assert {0.0, 255.0} < shades


def test_zeros_are_black(tmp_path):
    empty = [replace(each, envelope=np.zeros((13, 9), np.float32)) for each in images()]
    write_mcap(tmp_path / "a.mcap", iter(empty), series=SERIES, brightest=1.0)
    assert not any(any(image.data) for image in on_topic(messages(tmp_path / "a.mcap"), "/TRUS/pa/image"))


@pytest.mark.parametrize("number", range(3))
def test_the_frames_take_a_pixel_to_where_it_is(heard, number):
    """tf2's rule: a point's coordinates in the child, turned by the quaternion and moved, are those in the parent."""
    chain = on_topic(heard, "/tf")[number].transforms
    assert [(each.header.frame_id, each.child_frame_id) for each in chain] == [
        ("trus_home", "trus_probe"),
        ("trus_probe", "trus_image"),
    ]
    bank = json.loads(on_topic(heard, "/pa_search/bank")[0].data)
    point = np.array((6 * bank["lateral_spacing_m"], 4 * bank["depth_spacing_m"], 0))
    for each in reversed(chain):
        turn, move = each.transform.rotation, each.transform.translation
        turned = Rotation.from_quat((turn.x, turn.y, turn.z, turn.w)).apply(point)
        point = turned + np.array((move.x, move.y, move.z))
    np.testing.assert_allclose(1e3 * point, place_mm(number, 6, 4), atol=1e-9)


def test_without_a_face_radius_there_is_the_rotation_only(tmp_path):
    write_mcap(tmp_path / "a.mcap", iter(images()), series=UNPLACED, brightest=1.0)
    for number, message in enumerate(on_topic(messages(tmp_path / "a.mcap"), "/tf")):
        (only,) = message.transforms
        turn = only.transform.rotation
        vector = Rotation.from_quat((turn.x, turn.y, turn.z, turn.w)).as_rotvec(degrees=True)
        np.testing.assert_allclose(vector, (0, ANGLES[number], 0), atol=1e-9)


def test_messages_are_in_the_order_of_time_and_stamped(heard):
    logged = [time_ns for _, _, time_ns, _ in heard]
    assert logged == sorted(logged)
    assert sorted(set(logged)) == [35_250_000_000, 46_500_000_000, 1_000_000_000_000]
    stamps = [each.header.stamp for each in on_topic(heard, "/TRUS/measured_js")]
    assert [(each.sec, each.nanosec) for each in stamps] == [(35, 250_000_000), (46, 500_000_000), (1000, 0)]


def test_the_bank_is_told_once_and_kept_for_who_comes_late(tmp_path, heard):
    (told,) = on_topic(heard, "/pa_search/bank")
    bank = json.loads(told.data)
    assert (
        bank.items()
        >= {
            "angles": 3,
            "description": "a phantom",
            "simulated": True,
            "probe": "BPL9-5/55",
            "face_radius_m": 0.01,
            "reference_angle_deg": 1.5,
            "times": "seconds on the clock of the rig",
        }.items()
    )
    assert heard[0][0] == "/pa_search/bank"
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file)
        (record,) = reader.iter_metadata()
        qos = {each.topic: each.metadata["offered_qos_profiles"] for each in reader.get_summary().channels.values()}
    kept = record.metadata["serialized_metadata"]
    assert "markerseek:" in kept
    assert "BPL9-5/55" in kept
    assert "transient_local" in qos["/pa_search/bank"]


def test_mcap_of_intensities_alone(tmp_path):
    series = series_of(IntensityBank(angles_deg=ANGLES, intensities=(1.0, 2.0, 3.0)))
    write_mcap(tmp_path / "a.mcap", None, series=series)
    heard = messages(tmp_path / "a.mcap")
    assert {topic for topic, *_ in heard} == {
        "/TRUS/measured_js",
        "/tf",
        "/pa_search/bank",
        "/pa_search/sample",
        "/pa_search/intensity",
    }
    assert "numbered" in json.loads(on_topic(heard, "/pa_search/bank")[0].data)["times"]
    assert [each.header.stamp.sec for each in on_topic(heard, "/TRUS/measured_js")] == [0, 1, 2]
    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]


def test_an_unknown_intensity_is_null_for_programs_and_no_point_in_plots(tmp_path):
    write_mcap(tmp_path / "a.mcap", None, series=replace(SERIES, intensities=(1.0, math.nan, 3.0)))
    heard = messages(tmp_path / "a.mcap")
    assert [json.loads(each.data)["intensity"] for each in on_topic(heard, "/pa_search/sample")] == [1.0, None, 3.0]
    assert [each.data for each in on_topic(heard, "/pa_search/intensity")] == [1.0, 3.0]


@dataclass(frozen=True, kw_only=True)
class Frames(FrameBank):
    """A bank of which nobody asks a frame."""

    def frame(self, index):
        raise NotImplementedError

    dark_frame = frame


def frames(started_s, **more):
    return Frames(angles_deg=ANGLES, intensities=(1.0, 2.0, 3.0), started_s=started_s, **more)


def test_a_series_is_in_the_order_of_time():
    series = series_of(frames((30.5, 10.0, 20.0), pulses=(64, 65, 66)))
    assert (series.order, series.times_s, series.clock) == ((1, 2, 0), (10.0, 20.0, 30.5), "rig")
    assert (series.angles_deg, series.intensities) == ((0.25, 12.5, -30.0), (2.0, 3.0, 1.0))
    assert series.pulses == (65, 66, 64)
    assert series_of(frames((30.5, 10.0, 20.0)), intensities=(7.0, 8.0, 9.0)).intensities == (8.0, 9.0, 7.0)


def test_where_the_clock_began_gives_the_time_of_day(tmp_path):
    series = series_of(frames((30.5, 10.0, 20.0), facts=replace(FACTS, clock_zero_unix_s=1.7e9)))
    assert (series.times_s, series.clock) == ((1.7e9 + 10, 1.7e9 + 20, 1.7e9 + 30.5), "unix")
    write_sequence(tmp_path / "a.igs.mha", iter(images()), series=series)
    write_mcap(tmp_path / "a.mcap", iter(images()), series=series, brightest=1.0)
    image = sitk.ReadImage(str(tmp_path / "a.igs.mha"))
    assert [float(image.GetMetaData(f"Seq_Frame{number:04d}_Timestamp")) for number in range(3)] == [0, 10, 20.5]
    assert float(image.GetMetaData("markerseek_first_time_s")) == 1.7e9 + 10
    assert image.GetMetaData("markerseek_times").startswith("seconds since 1970-01-01")
    stamps = [each.header.stamp for each in on_topic(messages(tmp_path / "a.mcap"), "/TRUS/measured_js")]
    assert [(each.sec, each.nanosec) for each in stamps] == [
        (1_700_000_010, 0),
        (1_700_000_020, 0),
        (1_700_000_030, 500_000_000),
    ]


@pytest.mark.parametrize(
    "started_s",
    [(), (0.0, 0.0, 0.0), (1.0, math.nan, 3.0), (5.0, 5.0, 6.0), (0.0, 1e6, 1e6 + 0.5), (-1.0, 2.0, 3.0)],
    ids=["none", "not told", "not of all", "doubled", "too close for Slicer", "negative"],
)
def test_times_that_tell_nothing_are_numbers(started_s):
    series = series_of(frames(started_s, facts=replace(FACTS, clock_zero_unix_s=1.7e9)))
    assert (series.order, series.times_s, series.clock) == ((0, 1, 2), (0.0, 1.0, 2.0), "none")


@pytest.mark.parametrize(
    "wrong",
    [
        {"times_s": (0.0, 1.0)},
        {"times_s": (0.0, 2.0, 1.0)},
        {"times_s": (0.0, 1.0, math.nan)},
        {"intensities": (1.0,)},
        {"pulses": (1,)},
    ],
)
def test_a_series_that_does_not_fit_is_refused(wrong):
    with pytest.raises(ConfigError, match=r"series: "):
        replace(SERIES, **wrong)


@pytest.mark.parametrize("brightest", [None, 0.0, -1.0, math.nan, math.inf])
def test_a_picture_needs_something_bright(tmp_path, brightest):
    with pytest.raises(ConfigError, match=r"brightest is .* ADC counts"):
        write_mcap(tmp_path / "a.mcap", iter(images()), series=SERIES, brightest=brightest)
    assert list(tmp_path.iterdir()) == []


def test_a_table_is_read_back(tmp_path):
    write_intensities(tmp_path / "a.csv", angles_deg=ANGLES, intensities=(0.1, 1 / 3, 2e-17))
    bank = read_bank(tmp_path / "a.csv")
    assert (bank.angles_deg, bank.intensities) == (ANGLES, (0.1, 1 / 3, 2e-17))


def other_shape():
    first, second, _ = images()
    return [first, PaImage(envelope=second.envelope[:-1], lateral_m=LATERAL, depth_m=DEPTH[:-1])]


def test_nothing_is_left_of_an_export_that_fails(tmp_path):
    with pytest.raises(RecordError, match="keep one probe"):
        write_sequence(tmp_path / "a.igs.mha", iter(other_shape()), series=SERIES)
    for count in (0, 2, 4):
        given = (images() * 2)[:count]
        with pytest.raises(RecordError, match=r"3 angles and (0|2|more) images"):
            write_sequence(tmp_path / "a.igs.mha", iter(given), series=SERIES)
        with pytest.raises(RecordError, match=r"3 angles and (0|2|more) images"):
            write_mcap(tmp_path / "a.mcap", iter(given), series=SERIES, brightest=1.0)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    for place in ("file", "file/inside"):
        with pytest.raises(RecordError, match=r"there is a file already|cannot be written"):
            write_sequence(tmp_path / place, iter(images()), series=SERIES)
        with pytest.raises(RecordError, match=r"there is a file already|cannot be written"):
            write_mcap(tmp_path / place, iter(images()), series=SERIES, brightest=1.0)
