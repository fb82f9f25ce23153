"""Checks of ROS 2 commands and the settings of ROS 2 devices, without ROS."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.core import ConfigError, MissingExtraError
from markerseek.drivers import BenchSettings, Ros2ReceiverSettings, Ros2StageSettings
from markerseek.rigs import BenchRecipe, read_rig_file
from markerseek.ros import (
    RosNode,
    StampedCommands,
    degrees,
    joint_angle_deg,
    messages,
    node,
    require_middleware,
    set_up_discovery,
)

EXAMPLES = Path(__file__).parents[3] / "examples"

RIG = """
kind = "bench"
[stage]
driver = "ros2"
[laser]
driver = "ros2"
[receiver]
driver = "ros2"
"""


def written(tmp_path: Path, text: str) -> Path:
    (tmp_path / "rig.toml").write_text(text)
    return tmp_path / "rig.toml"


@given(st.floats(-180, 180).map(lambda angle_deg: round(angle_deg, 6)))
def test_an_end_of_a_range_stays_itself_on_its_way_over_radians(angle_deg: float) -> None:
    assert degrees(math.radians(angle_deg)) == pytest.approx(angle_deg, abs=1e-12)
    assert degrees(math.radians(angle_deg)) == angle_deg


@pytest.mark.parametrize(
    ("age_s", "said"), [(0.0, ""), (0.29, ""), (0.31, "0.31 s old"), (-0.04, ""), (-0.06, "0.06 s ahead")]
)
def test_the_age_of_a_stamp_decides(age_s: float, said: str) -> None:
    refusal = StampedCommands().refusal(round((1000.0 - age_s) * 1e9), now_s=1000.0)
    assert (refusal is None) == (said == "")
    assert said in (refusal or "")


def test_item_4_a_clock_that_is_set_back_does_not_make_every_stamp_a_repetition() -> None:
    commands = StampedCommands()
    assert commands.refusal(1_000_000_000_000, now_s=1000.0) is None
    assert commands.refusal(970_000_000_000, now_s=970.0) is None
    assert "repetition" in (commands.refusal(970_000_000_000, now_s=970.0) or "")


def test_a_stamp_is_used_once_and_none_is_none() -> None:
    commands = StampedCommands()
    assert commands.refusal(1_000_000_000_000, now_s=1000.0) is None
    assert "repetition" in (commands.refusal(1_000_000_000_000, now_s=1000.0) or "")
    assert "no stamp" in (commands.refusal(0, now_s=1000.0) or "")
    assert "old" in (commands.refusal(999_000_000_000, now_s=1000.0) or "")
    # A computer whose date is not known compares with nothing.
    assert commands.refusal(1_000_100_000_000, now_s=math.nan) is not None


@pytest.mark.parametrize(
    ("names", "position", "angle_deg"),
    [
        (["trus_roll"], [math.pi / 6], 30.0),
        ([], [math.pi / 6], 30.0),
        (["other"], [0.1], None),
        (["insertion", "trus_roll", "other"], [0.1, math.pi / 9, 0.2], 20.0),
        (["trus_roll", "trus_roll"], [0.1, 0.2], None),
        (["trus_roll", "other"], [0.1], None),
        ([], [0.1, 0.2], None),
        (["trus_roll"], [], None),
        (["trus_roll"], [math.nan], None),
        (["trus_roll"], [math.inf], None),
    ],
)
def test_a_joint_state_is_one_finite_angle_of_the_joint(
    names: list[str], position: list[float], angle_deg: float | None
) -> None:
    assert joint_angle_deg(SimpleNamespace(name=names, position=position)) == angle_deg


def test_channel_data_survive_as_an_image_and_a_wrong_size_is_refused() -> None:
    counts = np.arange(-6, 6, dtype=np.int16).reshape(3, 4)
    message = SimpleNamespace(height=3, width=4, step=8, encoding="16SC1", is_bigendian=0, data=counts.tobytes())
    assert (messages.channel_data_of(message) == counts).all()
    message.is_bigendian = 1
    message.data = counts.astype(">i2").tobytes()
    assert (messages.channel_data_of(message) == counts).all()
    for wrong in ({"height": 2}, {"step": 4}, {"encoding": "mono8"}, {"data": b""}, {"height": 0, "data": b""}):
        assert messages.channel_data_of(SimpleNamespace(**{**vars(message), **wrong})) is None


@pytest.mark.parametrize("data", ["", "[]", "{", '{"id":1}', "[" * 10_000, "\ud800", '{"id":"a","pulses":1e99}'])
def test_a_text_that_is_no_request_is_none(data: str) -> None:
    assert messages.decoded(data, messages.AcquireRequest) is None


def test_the_operating_state_of_crtk_is_understood() -> None:
    header = SimpleNamespace(stamp=SimpleNamespace(sec=2, nanosec=5))
    message = SimpleNamespace(header=header, state="ENABLED", is_homed=True, is_busy=True)
    expected = messages.OperatingState(state="ENABLED", is_homed=True, is_busy=True, stamp_ns=2_000_000_005)
    assert messages.state_of(message) == expected


def test_a_rig_file_names_nodes_without_port_and_zero(tmp_path: Path) -> None:
    settings = read_rig_file(written(tmp_path, RIG))
    assert isinstance(settings, BenchSettings)
    assert settings.stage == Ros2StageSettings()
    assert settings.receiver == Ros2ReceiverSettings()
    # As a journal stores it, and reads it back.
    recipe = msgspec.json.decode(msgspec.json.encode(BenchRecipe.of(settings)), type=BenchRecipe)
    assert recipe.settings == settings


@pytest.mark.parametrize(
    ("found", "wanted", "said"),
    [
        ('[laser]\ndriver = "ros2"', '[laser]\nport = "/dev/ttyACM0"', "ros2 is laser and receiver: name ros2 in both"),
        (
            '[stage]\ndriver = "ros2"',
            '[stage]\ndriver = "rosbag"',
            "stage.driver is 'rosbag', it must be one of: kdc101, guided",
        ),
        (
            '[stage]\ndriver = "ros2"',
            '[stage]\ndriver = "ros2"\nport = "/dev/ttyUSB0"',
            "the key stage.port is unknown",
        ),
        ('[stage]\ndriver = "ros2"', '[stage]\ndriver = "ros2"\nunit = "deg"', "a joint_state is in radians"),
        ('[stage]\ndriver = "ros2"', '[stage]\ndriver = "ros2"\nmessage = "float64"', "add state_topic = 'none'"),
        ('[stage]\ndriver = "ros2"', '[stage]\ndriver = "ros2"\ntimeout_s = 0', "timeout_s is 0"),
        ('[stage]\ndriver = "ros2"', "[stage]", "the key stage.zero_deg is missing"),
    ],
)
def test_a_rig_file_that_cannot_be_met_is_refused(tmp_path: Path, found: str, wanted: str, said: str) -> None:
    assert found in RIG
    with pytest.raises(ConfigError, match=r"rig\.toml") as refused:
        read_rig_file(written(tmp_path, RIG.replace(found, wanted)))
    assert said in str(refused.value)


def test_without_ros_the_command_that_installs_it_is_named() -> None:
    try:
        import rclpy  # noqa: F401
    except ImportError:
        with pytest.raises(MissingExtraError, match=r"ROS 2 needs the package rclpy.*pip install '\.\[ros2\]'"):
            RosNode("nobody")
    else:
        pytest.skip("ROS 2 is installed here")


def test_nodes_are_looked_for_on_this_computer_unless_the_user_chose(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    names = "FASTDDS_BUILTIN_TRANSPORTS", "FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"
    for name in (*names, "RMW_IMPLEMENTATION", "ROS_AUTOMATIC_DISCOVERY_RANGE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    monkeypatch.setenv(names[0], "UDPv4")
    assert set_up_discovery() == "ROS 2 domain 7 (ROS_DOMAIN_ID), by FASTDDS_BUILTIN_TRANSPORTS=UDPv4"
    monkeypatch.setenv(names[0], "SHM")
    assert set_up_discovery().endswith(
        "in shared memory only (FASTDDS_BUILTIN_TRANSPORTS=SHM), where nodes of default settings are not; unset it"
    )
    monkeypatch.delenv(names[0])
    # What was set for one transport is not taken for a choice of the user.
    assert "on this computer only (127.0.0.1 and shared memory)" in set_up_discovery()
    monkeypatch.setenv(names[1], "profiles.xml")
    assert set_up_discovery().endswith("as profiles.xml says (FASTDDS_DEFAULT_PROFILES_FILE)")
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    assert set_up_discovery().endswith(
        ", ROS_AUTOMATIC_DISCOVERY_RANGE=OFF, as rmw_zenoh_cpp is set up (RMW_IMPLEMENTATION)"
    )


def test_a_middleware_is_looked_for_where_ros_has_its_packages(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    index = tmp_path / "share" / "ament_index" / "resource_index" / "rmw_typesupport"
    index.mkdir(parents=True)
    for name in ("rmw_zenoh_cpp", "rmw_implementation"):
        (index / name).touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/opt/none:{tmp_path}")
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")
    require_middleware()
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_implementation")
    with pytest.raises(
        ConfigError, match=r"RMW_IMPLEMENTATION is rmw_implementation, which is not installed here \(.*"
    ):
        require_middleware()


def test_the_example_of_a_ros_rig_has_the_defaults_and_names_every_key(tmp_path: Path) -> None:
    example = read_rig_file(EXAMPLES / "rigs" / "ros2.toml")
    usual = read_rig_file(written(tmp_path, RIG + "[probe]\nface_radius_m = 0.01\n"))
    assert example == usual
    text = (EXAMPLES / "rigs" / "ros2.toml").read_text()
    for kind in (Ros2StageSettings, Ros2ReceiverSettings):
        for name in kind.__struct_fields__:
            assert f"\n{name} = " in text


def test_a_message_is_put_into_words_only_for_a_reader_and_a_long_one_by_its_length(
    caplog: pytest.LogCaptureFixture,
) -> None:
    stamp = SimpleNamespace(sec=7, nanosec=5000)
    image = SimpleNamespace(header=SimpleNamespace(stamp=stamp), data=np.zeros(3 * 640 * 480, np.uint8))
    joint = SimpleNamespace(position=[0.25, 1.5])
    text = SimpleNamespace(data="frame " * 1000)
    assert node.message_text(image) == "SimpleNamespace stamped 7.000005000 921600 values"
    assert node.message_text(joint) == "SimpleNamespace [0.25, 1.5]"
    assert node.message_text(text).endswith("frame frame")
    assert len(node.message_text(text)) < 150
    for level, lines in ((logging.INFO, 0), (logging.DEBUG, 1)):
        with caplog.at_level(level, "markerseek.ros.node"):
            node._note("/angle", "<", joint)
        assert len(caplog.messages) == lines
    assert caplog.messages == ["/angle < SimpleNamespace [0.25, 1.5]"]
