"""MCAP logs for ROS 2 and Foxglove, read back by the library mcap; rotations against SciPy."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError
from markerseek.records.banks import IntensityBank
from markerseek.records.exports import series_of, write_mcap
from tests.unit.records.exports.exported import ANGLES, SERIES, TIMES, UNPLACED, images, messages, on_topic, place_mm


@pytest.fixture
def decoded(tmp_path):
    write_mcap(tmp_path / "a.mcap", iter(images()), series=SERIES, brightest=0.9)
    return messages(tmp_path / "a.mcap")


def test_mcap_has_the_topics_of_a_running_rig(decoded):
    assert {topic: kind for topic, kind, _, _ in decoded} == {
        "/TRUS/measured_js": "sensor_msgs/msg/JointState",
        "/TRUS/pa/image": "sensor_msgs/msg/Image",
        "/TRUS/pa/envelope": "sensor_msgs/msg/Image",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/pa_search/bank": "std_msgs/msg/String",
        "/pa_search/sample": "std_msgs/msg/String",
        "/pa_search/intensity": "std_msgs/msg/Float64",
    }
    joints = on_topic(decoded, "/TRUS/measured_js")
    assert [(each.name, each.header.frame_id) for each in joints] == [(["trus_roll"], "trus_home")] * 3
    np.testing.assert_allclose([each.position[0] for each in joints], np.radians(ANGLES))


def test_intensities_are_there_for_plots_and_for_programs(decoded):
    assert [each.data for each in on_topic(decoded, "/pa_search/intensity")] == [1.0, 2.0, 3.0]
    samples = [json.loads(each.data) for each in on_topic(decoded, "/pa_search/sample")]
    assert [(each["index"], each["angle_deg"], each["intensity"], each["time_s"]) for each in samples] == list(
        zip((1, 2, 3), ANGLES, (1.0, 2.0, 3.0), TIMES, strict=True)
    )


def test_pulses_are_written_where_they_are_known(tmp_path):
    write_mcap(tmp_path / "a.mcap", None, series=replace(SERIES, pulses=(64, 64, 12)))
    recorded = [
        json.loads(each.data)["pulses"] for each in on_topic(messages(tmp_path / "a.mcap"), "/pa_search/sample")
    ]
    assert recorded == [64, 64, 12]


def test_the_envelope_is_exact(decoded):
    for expected, image in zip(images(), on_topic(decoded, "/TRUS/pa/envelope"), strict=True):
        assert (image.height, image.width, image.encoding, image.step) == (13, 9, "32FC1", 36)
        np.testing.assert_array_equal(np.frombuffer(bytes(image.data), "<f4").reshape(13, 9), expected.envelope)


def test_a_picture_holds_the_envelope_to_half_a_step(decoded):
    """By the formula of the module, with the numbers in the file."""
    bank = json.loads(on_topic(decoded, "/pa_search/bank")[0].data)
    white, range_db = bank["picture_white"], bank["picture_range_db"]
    assert white == 0.9
    shades = set()
    for expected, image in zip(images(), on_topic(decoded, "/TRUS/pa/image"), strict=True):
        assert (image.height, image.width, image.encoding, image.step) == (13, 9, "mono8", 9)
        assert image.header.frame_id == "trus_image"
        shade = np.frombuffer(bytes(image.data), np.uint8).reshape(13, 9).astype(float)
        recorded = white * 10 ** ((shade / 255 - 1) * range_db / 20)
        inside = (expected.envelope < white) & (expected.envelope > white * 10 ** (-range_db / 20))
        off_db = 20 * np.log10(recorded[inside] / expected.envelope[inside])
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
def test_the_frames_take_a_pixel_to_where_it_is(decoded, number):
    """tf2's rule: a point's coordinates in the child, turned by the quaternion and moved, are those in the parent."""
    chain = on_topic(decoded, "/tf")[number].transforms
    assert [(each.header.frame_id, each.child_frame_id) for each in chain] == [
        ("trus_home", "trus_probe"),
        ("trus_probe", "trus_image"),
    ]
    bank = json.loads(on_topic(decoded, "/pa_search/bank")[0].data)
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


def test_messages_are_in_the_order_of_time_and_stamped(decoded):
    logged = [time_ns for _, _, time_ns, _ in decoded]
    assert logged == sorted(logged)
    assert sorted(set(logged)) == [35_250_000_000, 46_500_000_000, 1_000_000_000_000]
    stamps = [each.header.stamp for each in on_topic(decoded, "/TRUS/measured_js")]
    assert [(each.sec, each.nanosec) for each in stamps] == [(35, 250_000_000), (46, 500_000_000), (1000, 0)]


def test_the_bank_is_published_once_and_latched_for_late_subscribers(tmp_path, decoded):
    (recorded,) = on_topic(decoded, "/pa_search/bank")
    bank = json.loads(recorded.data)
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
    assert decoded[0][0] == "/pa_search/bank"
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
    decoded = messages(tmp_path / "a.mcap")
    assert {topic for topic, *_ in decoded} == {
        "/TRUS/measured_js",
        "/tf",
        "/pa_search/bank",
        "/pa_search/sample",
        "/pa_search/intensity",
    }
    assert "numbered" in json.loads(on_topic(decoded, "/pa_search/bank")[0].data)["times"]
    assert [each.header.stamp.sec for each in on_topic(decoded, "/TRUS/measured_js")] == [0, 1, 2]
    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]


def test_an_unknown_intensity_is_null_for_programs_and_no_point_in_plots(tmp_path):
    write_mcap(tmp_path / "a.mcap", None, series=replace(SERIES, intensities=(1.0, math.nan, 3.0)))
    decoded = messages(tmp_path / "a.mcap")
    assert [json.loads(each.data)["intensity"] for each in on_topic(decoded, "/pa_search/sample")] == [1.0, None, 3.0]
    assert [each.data for each in on_topic(decoded, "/pa_search/intensity")] == [1.0, 3.0]


@pytest.mark.parametrize("brightest", [None, 0.0, -1.0, math.nan, math.inf])
def test_a_picture_needs_something_bright(tmp_path, brightest):
    with pytest.raises(ConfigError, match=r"brightest is .* ADC counts"):
        write_mcap(tmp_path / "a.mcap", iter(images()), series=SERIES, brightest=brightest)
    assert list(tmp_path.iterdir()) == []
