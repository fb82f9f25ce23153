"""A probe that a person turns: the angle must be steady near the one asked for, and an encoder that lies is refused."""

from __future__ import annotations

import math
import os
import pty
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek import rigs
from markerseek.contract import StageContract
from markerseek.core import (
    ConfigError,
    DeviceTimeoutError,
    LimitError,
    MoveError,
    NotConnectedError,
    Stage,
    Turning,
)
from markerseek.drivers import (
    BenchSettings,
    GuidedStage,
    GuidedStageSettings,
    IgtlEncoder,
    Ros2Encoder,
    SystemClock,
    TypedStage,
)
from markerseek.guard import Limits, State
from markerseek.records.banks import probe_to_probe_home
from markerseek.runs import scan_angles
from markerseek.sim import HandMotion, SimulatedHand, VirtualClock
from markerseek.wire import igtl

LIMITS = Limits()
OPERATING_STATE = '{"state": "ENABLED", "is_homed": true, "is_busy": false, "stamp_ns": 1, "simulated": true}'
"""As a stage node of ours says it."""
SETTINGS = GuidedStageSettings()


class Turned:
    """A world whose probe a hand turns."""

    def __init__(self) -> None:
        self.angle_deg = 0.0


def guided(
    clock: VirtualClock, encoder: object, *, settings: GuidedStageSettings = SETTINGS, asks: Callable[[float], None]
) -> GuidedStage:
    return GuidedStage(encoder=encoder, clock=clock, settings=settings, limits=LIMITS, asks=asks)  # type: ignore[arg-type]


def hand(clock: VirtualClock, *, motion: HandMotion | None = None) -> SimulatedHand:
    rng = np.random.default_rng(1)
    return SimulatedHand(world=Turned(), clock=clock, limits=LIMITS.search, rng=rng, motion=motion)  # type: ignore[arg-type]


class TestGuidedStage(StageContract):
    resolution_deg = SETTINGS.reach_deg
    reaches = LIMITS.search

    def make(self) -> Stage:
        clock = VirtualClock()
        turner = hand(clock, motion=HandMotion(drift_deg_s=0.0))
        # A hand that can be led to the ends of the travel, so that the contract's angles are all of the search range.
        limits = Limits(search=LIMITS.search, travel=LIMITS.search)
        return GuidedStage(encoder=turner, clock=clock, settings=SETTINGS, limits=limits, asks=turner.turn_to)


def test_it_takes_the_angle_reached_once_the_hand_rests() -> None:
    clock = VirtualClock()
    turner = hand(clock)
    stage = guided(clock, turner, asks=turner.turn_to)
    began_s = clock.now_s()
    shown = list(stage.guide(-12.0))
    assert shown[0] == Turning(target_deg=-12.0, angle_deg=0.0)
    # It went 2 degrees too far on its way.
    assert min(each.angle_deg for each in shown if each.angle_deg is not None) < -13.5
    reached_deg = stage.move_to(-12.0)
    assert 0.1 <= abs(reached_deg + 12.0) <= SETTINGS.reach_deg
    assert clock.now_s() - began_s > 3 + SETTINGS.steady_s


def test_nobody_is_asked_again_where_the_probe_still_is() -> None:
    clock = VirtualClock()
    turner = hand(clock)
    asked = []
    stage = guided(clock, turner, asks=lambda angle_deg: (asked.append(angle_deg), turner.turn_to(angle_deg)))  # type: ignore[func-returns-value]
    stage.move_to(5.0)
    stage.move_to(5.0)
    stage.move_to(6.0)
    assert asked == [5.0, 6.0]


class Scripted:
    """An encoder that tells what a function of the time says."""

    emulated = False
    unused = ""

    def __init__(self, clock: VirtualClock, angle_deg: Callable[[float], float | None]) -> None:
        self.clock = clock
        self.angle = angle_deg

    def read(self) -> float | None:
        return self.angle(self.clock.now_s())


@pytest.mark.parametrize(
    ("angle", "asked_deg", "error", "says"),
    [
        pytest.param(lambda _s: 3.0, 10.0, DeviceTimeoutError, "has stayed at 3.00 deg", id="frozen"),
        # Near the next angle by chance: it is not taken for one that was turned there.
        pytest.param(lambda _s: 3.0, 3.5, DeviceTimeoutError, "may stand still", id="frozen near the angle"),
        pytest.param(lambda s: min(s, 6.0), 10.0, DeviceTimeoutError, "it is at 6.00 deg", id="freezes on its way"),
        pytest.param(lambda s: 0.0 if s < 2 else 10.0, 10.0, MoveError, "jumped from 0.00 to 10.00", id="jumps"),
        pytest.param(lambda s: 0.0 if s < 2 else math.nan, 10.0, MoveError, "no angle", id="not a number"),
        pytest.param(lambda s: 0.0 if s < 2 else None, 10.0, DeviceTimeoutError, "reported no angle for", id="silent"),
        pytest.param(lambda s: -min(s, 10.0), 10.0, DeviceTimeoutError, "it is at -10.00", id="turns the other way"),
        pytest.param(lambda s: min(3 * s, 36.0), 35.5, DeviceTimeoutError, "rest there", id="rests out of the range"),
        pytest.param(
            lambda s: 10 + 0.6 * math.sin(3 * s) if s > 1 else 10 * s, 10.0, DeviceTimeoutError, "rest", id="trembles"
        ),
    ],
)
def test_an_encoder_that_lies_is_refused(
    angle: Callable[[float], float | None], asked_deg: float, error: type[Exception], says: str
) -> None:
    clock = VirtualClock()
    stage = guided(clock, Scripted(clock, angle), asks=lambda _angle_deg: None)
    with pytest.raises(error, match=says):
        stage.move_to(asked_deg)


def test_an_encoder_that_tells_nothing_is_not_connected() -> None:
    clock = VirtualClock()
    with pytest.raises(NotConnectedError, match="no angle came from its encoder within 10 s"):
        guided(clock, Scripted(clock, lambda _s: None), asks=lambda _angle_deg: None)


def test_zero_and_direction_are_those_of_the_rig_file() -> None:
    clock = VirtualClock()
    settings = GuidedStageSettings(zero_deg=350.0, direction="reverse")
    stage = guided(clock, Scripted(clock, lambda _s: -20.0), settings=settings, asks=lambda _angle_deg: None)
    # The encoder is 10 degrees above its zero, which lies across 360.
    assert stage.angle_deg == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"reach_deg": 5.0}, "reach_deg is 5.0 deg"),
        ({"reach_deg": math.nan}, "reach_deg is nan"),
        ({"steady_deg": 0.5, "reach_deg": 0.4}, "must be finer"),
        ({"device": ""}, "one or more characters"),
        ({"device": "Schallköpf"}, "characters of ASCII"),
    ],
)
def test_keys_that_cannot_be_used_are_refused(keys: dict[str, object], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        GuidedStageSettings(**keys)  # type: ignore[arg-type]


class Server:
    """A server of OpenIGTLink that sends what it is told to."""

    def __init__(self) -> None:
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.now_s = 1.75e9
        self.encoder = IgtlEncoder(
            clock=SystemClock(),
            settings=GuidedStageSettings(port=self.listening.getsockname()[1], connect_s=2.0),
            unix_s=lambda: self.now_s,
        )
        self.line, _ = self.listening.accept()

    def send(self, matrix: object, *, stamp_s: float | None = None, **metadata: str) -> float | None:
        """Send a transform, and read the encoder; without ``metadata`` its ``TransformStatus`` is OK."""
        stamp_s = self.now_s if stamp_s is None else stamp_s
        message = igtl.Message(
            device="ProbeToProbeHome",
            content=igtl.Transform(matrix=None if matrix is None else np.asarray(matrix, np.float64)),
            time_s=stamp_s,
            metadata=metadata or {"TransformStatus": "OK"},
        )
        return self.send_bytes(igtl.encode(message))

    def send_bytes(self, data: bytes) -> float | None:
        self.line.sendall(data)
        # The bytes are in the connection's buffer once the kernel has taken them: both ends are on this computer.
        return self.encoder.read()

    def close(self) -> None:
        self.encoder.close()
        self.line.close()
        self.listening.close()


@pytest.fixture
def server() -> Iterator[Server]:
    made = Server()
    yield made
    made.close()


@pytest.mark.parametrize("angle_deg", [-35.0, -0.125, 0.0, 12.5, 170.0])
def test_the_angle_of_a_transform_is_that_of_the_exports(server: Server, angle_deg: float) -> None:
    # Matrices travel in single precision.
    assert server.send(probe_to_probe_home(angle_deg)) == pytest.approx(angle_deg, abs=1e-4)


def test_messages_that_are_not_of_now_tell_no_angle(server: Server) -> None:
    home = probe_to_probe_home(1.0)
    assert server.send(home) is not None
    assert server.send(home) is None
    assert "repeat one time stamp" in server.encoder.unused
    server.now_s += 10
    assert server.send(home, stamp_s=server.now_s - 2) is None
    assert "2.00 s old" in server.encoder.unused
    assert server.send(home, stamp_s=server.now_s + 2) is None
    assert "ahead of this computer's clock" in server.encoder.unused
    assert server.send(home, stamp_s=0.0) is None
    assert "carry no time" in server.encoder.unused
    assert server.send(home, TransformStatus="INVALID") is None
    assert "INVALID" in server.encoder.unused

    assert server.send(None) is None
    assert server.encoder.unused == "its transform is NaN"
    assert server.send(home) == pytest.approx(1.0, abs=1e-4)
    assert server.encoder.unused == ""


def test_transforms_of_other_devices_are_named(server: Server) -> None:
    for device in ("ProbeToReference", "StylusToReference"):
        content = igtl.Transform(matrix=np.eye(4))
        assert server.send_bytes(igtl.encode(igtl.Message(device=device, content=content, time_s=server.now_s))) is None
    assert server.encoder.unused == (
        "TRANSFORM came of 'ProbeToReference', 'StylusToReference', none of 'ProbeToProbeHome'"
    )


@pytest.mark.parametrize(
    ("metadata", "said"),
    [
        ({"TransformValid": "1"}, ""),
        ({"TransformValid": "true", "TransformStatus": "OK"}, ""),
        ({"TransformValid": "0"}, "not valid: TransformValid is '0'"),
        ({"TransformValid": "False", "TransformStatus": "OK"}, "not valid: TransformValid is 'False'"),
        ({"TransformValid": "1", "TransformStatus": "MISSING"}, "it says that its transform is 'MISSING'"),
        ({"Other": "1"}, "does not state by TransformStatus in its metadata that it is valid"),
    ],
)
def test_older_servers_state_by_another_name_whether_a_transform_is_valid(
    server: Server, metadata: dict[str, str], said: str
) -> None:
    angle_deg = server.send(probe_to_probe_home(-7.0), **metadata)
    assert said in server.encoder.unused
    assert (angle_deg is None) == bool(said)
    assert "require_status" not in server.encoder.unused


@pytest.mark.parametrize(
    ("matrix", "says"),
    [
        (np.diag([1.0, 2.0, 1.0, 1.0]), "no rotation"),
        (np.diag([-1.0, 1.0, 1.0, 1.0]), "no rotation"),
        (np.diag([1.0, -1.0, -1.0, 1.0]), "another axis than y"),
        (np.array([[1, 0, 0, 0], [0, 0.8, -0.6, 0], [0, 0.6, 0.8, 0], [0, 0, 0, 1.0]]), "another axis than y"),
    ],
)
def test_a_transform_that_is_no_turn_of_the_probe_is_refused(server: Server, matrix: object, says: str) -> None:
    with pytest.raises(MoveError, match=says):
        server.send(matrix)


def test_a_probe_that_is_shifted_is_refused(server: Server) -> None:
    server.send(probe_to_probe_home(1.0))
    shifted = probe_to_probe_home(1.0)
    shifted[1, 3] = 5.0
    server.now_s += 1
    with pytest.raises(MoveError, match=r"shifted by 5\.0 mm"):
        server.send(shifted)


def test_a_server_that_sends_garbage_or_ends_is_not_connected(server: Server) -> None:
    with pytest.raises(NotConnectedError, match="another protocol"):
        server.send_bytes(b"GET / HTTP/1.1\r\n" * 10)
    server.line.close()
    with pytest.raises(NotConnectedError):
        server.encoder.read()


class Node:
    """A ROS 2 node that hands over what it is given."""

    def __init__(self) -> None:
        self.time_s = 1.75e9

    def publishes(self, _topic: str) -> bool:
        return True

    def subscribe(self, _topic: str, kind: str, callback: Callable[[object], None]) -> None:
        if kind == "std_msgs/msg/String":
            self.say_state = callback
        else:
            self.hand_over = callback

    def drain(self, _most: int) -> None:
        pass

    def now_s(self) -> float:
        return self.time_s

    def stamped(self, **fields: object) -> SimpleNamespace:
        stamp = SimpleNamespace(sec=int(self.time_s), nanosec=0)
        return SimpleNamespace(header=SimpleNamespace(stamp=stamp), **fields)


def ros2_transform(rotation: Rotation) -> SimpleNamespace:
    turn = SimpleNamespace(**dict(zip("xyzw", rotation.as_quat().tolist(), strict=True)))
    return SimpleNamespace(rotation=turn, translation=SimpleNamespace(x=0.0, y=0.0, z=0.0))


@pytest.mark.parametrize(("axis", "name"), list(enumerate("xyz")))
def test_a_transform_of_ros_2_turns_as_scipy_says(axis: int, name: str) -> None:
    node = Node()
    settings = GuidedStageSettings(encoder="ros2", message="transform", axis=name)  # type: ignore[arg-type]
    encoder = Ros2Encoder(node=node, settings=settings)  # type: ignore[arg-type]
    assert encoder.read() is None
    for angle_deg in (-80.0, 12.5, 100.0):
        node.time_s += 1
        node.hand_over(node.stamped(transform=ros2_transform(Rotation.from_euler(name, angle_deg, degrees=True))))
        assert encoder.read() == pytest.approx(angle_deg, abs=1e-9)
    node.time_s += 1
    other = Rotation.from_euler("xyz"[axis - 1], 30.0, degrees=True)
    node.hand_over(node.stamped(transform=ros2_transform(other)))
    with pytest.raises(MoveError, match="another axis"):
        encoder.read()
    node.time_s += 1
    longer = ros2_transform(Rotation.identity())
    longer.rotation.w = 2.0
    node.hand_over(node.stamped(transform=longer))
    with pytest.raises(MoveError, match="no rotation"):
        encoder.read()


def test_a_joint_of_ros_2_is_in_radians() -> None:
    node = Node()
    encoder = Ros2Encoder(node=node, settings=GuidedStageSettings(encoder="ros2"))  # type: ignore[arg-type]
    node.hand_over(node.stamped(name=["trus_roll"], position=[math.radians(-12.5)]))
    assert encoder.read() == pytest.approx(-12.5)
    node.time_s += 1
    node.hand_over(node.stamped(name=["yaw", "insertion"], position=[0.1, 0.2]))
    assert encoder.read() is None
    assert encoder.unused == "its message has the joints yaw, insertion, and no number of 'trus_roll'"
    # Of another node on the same topic: the angle that came before it counts.
    node.hand_over(node.stamped(name=["trus_roll"], position=[math.radians(4.0)]))
    node.hand_over(node.stamped(name=["gripper"], position=[0.3]))
    assert encoder.read() == pytest.approx(4.0)
    node.time_s += 1
    node.hand_over(node.stamped(name=["trus_roll"], position=[math.nan]))
    assert math.isnan(encoder.read() or 0.0)
    late = node.stamped(name=["trus_roll"], position=[0.0])
    node.time_s += 3
    node.hand_over(late)
    assert encoder.read() is None
    assert not encoder.emulated
    node.say_state(SimpleNamespace(data="anything else"))
    assert not encoder.emulated
    node.say_state(SimpleNamespace(data=OPERATING_STATE))
    assert encoder.emulated


def test_the_guard_of_its_rig_accepts_what_a_hand_reaches_and_no_more() -> None:
    file = Path(__file__).parents[3] / "examples" / "rigs" / "guided.toml"
    settings = rigs.read_rig_file(file)
    assert isinstance(settings, BenchSettings)
    with rigs.bench(settings) as rig:
        guard = rig.scanner.guard
        assert rig.facts.emulated == ("stage", "laser", "receiver")
        assert guard.state is State.DISARMED
        assert scan_angles(rig, step_deg=5.0) == 15
        with pytest.raises(ConfigError, match="turned by hand, to within 1 deg: take steps of at least 3 deg"):
            scan_angles(rig, step_deg=2.0)
        guard.arm(by="a person")
        guard.begin_move(10.0)
        guard.end_move(11.2)
        guard.begin_move(10.0)
        with pytest.raises(MoveError, match=r"more than 1\.3 deg away"):
            guard.end_move(11.4)


class Terminal:
    """A terminal at which a person types."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.person, of_program = pty.openpty()
        self.stdin = os.fdopen(of_program, "r")
        monkeypatch.setattr("sys.stdin", self.stdin)

    def close(self) -> None:
        self.stdin.close()
        os.close(self.person)


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminal]:
    made = Terminal(monkeypatch)
    yield made
    made.close()


class TypingClock(VirtualClock):
    """A person types the next line whenever the program waits for one."""

    def __init__(self, terminal: Terminal, *typed: str) -> None:
        super().__init__()
        self._terminal = terminal
        self._typed = list(typed)

    def wait(self, duration_s: float) -> None:
        super().wait(duration_s)
        if self._typed:
            os.write(self._terminal.person, self._typed.pop(0).encode() + b"\n")


def typed_stage(clock: VirtualClock) -> TypedStage:
    settings = GuidedStageSettings(encoder="typed", timeout_s=5.0)
    return TypedStage(clock=clock, settings=settings, limits=LIMITS, asks=lambda _angle_deg: None)


def test_what_is_typed_counts_only_near_the_angle_asked_for(
    terminal: Terminal, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = TypingClock(terminal, "0", "twelve", "12,4", "nan", "-10", "−12,4°")
    stage = typed_stage(clock)
    assert stage.angle_deg == 0.0
    assert stage.move_to(-12.0) == -12.4
    assert capsys.readouterr().err.count("no such angle") == 4
    # The same angle again: it has not been left.
    assert stage.move_to(-12.0) == -12.4
    with pytest.raises(LimitError):
        stage.move_to(math.nan)


def test_a_person_who_types_nothing_ends_it(terminal: Terminal) -> None:
    stage = typed_stage(TypingClock(terminal, "0"))
    with pytest.raises(DeviceTimeoutError, match="no angle was typed within 5 s"):
        stage.move_to(3.0)


def test_without_a_terminal_nothing_can_be_typed(monkeypatch: pytest.MonkeyPatch) -> None:
    with Path(os.devnull).open() as nothing:
        monkeypatch.setattr("sys.stdin", nothing)
        with pytest.raises(NotConnectedError, match="no terminal"):
            typed_stage(VirtualClock())
