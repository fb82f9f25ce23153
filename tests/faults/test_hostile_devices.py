"""Invalid answers of devices: a `DeviceError` with a sentence, or a valid result; never anything else.

No crash, no hang, no memory allocated for a claimed size. ``tests/faults/corpus`` holds inputs that once failed this,
by the name of the decoder; ``tests/faults/fuzz.py`` searches for more.
"""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from markerseek.core import MoveError, NotConnectedError
from markerseek.drivers import Kdc101Settings, Kdc101Stage, LaserBox
from markerseek.drivers.sonixdaq import DaqFolder
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.sim import VirtualClock
from markerseek.wire import laserbox
from tests.emulated_lines import DirectPort
from tests.faults.wire_decoders import WIRES, ScriptedPort, wire_outcome
from tests.sizes import examples

CORPUS = Path(__file__).parent / "corpus"
ROOM_BYTES = 3_000_000


@pytest.mark.parametrize("decoder", sorted(WIRES))
def test_a_sound_device_is_understood(decoder: str) -> None:
    """Without it the other tests could not fail."""
    whole, decode = WIRES[decoder]
    assert wire_outcome(decode, whole()) == "read"


@settings(max_examples=examples(150), deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data(), decoder=st.sampled_from(sorted(WIRES)))
def test_damaged_answers_are_understood_or_refused(data: st.DataObject, decoder: str) -> None:
    whole, decode = WIRES[decoder]
    damaged = bytearray(whole())
    for _ in range(data.draw(st.integers(1, 8))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    length = data.draw(st.just(len(damaged)) | st.integers(0, len(damaged)))
    assert wire_outcome(decode, bytes(damaged[:length])) in ("read", "refused")


@settings(max_examples=examples(60), deadline=None, derandomize=True)
@given(data=st.binary(max_size=300), decoder=st.sampled_from(sorted(WIRES)))
def test_any_answers_are_understood_or_refused(data: bytes, decoder: str) -> None:
    assert wire_outcome(WIRES[decoder][1], data) in ("read", "refused")


@pytest.mark.parametrize("decoder", ["kdc101", "laserbox", "picolas"])
@pytest.mark.parametrize("noise", [b"\x01\xff" + b"\xa5" * 255, b"\x01\x01*", b"\x01\x02\n\n"])
def test_a_device_that_never_ends_is_refused_and_costs_little(decoder: str, noise: bytes) -> None:
    decode = WIRES[decoder][1]
    wire_outcome(decode, b"\0")  # what is loaded at first is not counted
    tracemalloc.start()
    outcome = wire_outcome(decode, noise)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert outcome == "refused"
    assert most < ROOM_BYTES


def corpus() -> list[Path]:
    return [path for decoder in WIRES for path in sorted((CORPUS / decoder).glob("*"))]


@pytest.mark.parametrize("path", corpus(), ids=lambda path: f"{path.parent.name}/{path.name}")
def test_inputs_that_once_did_harm_are_refused(path: Path) -> None:
    assert wire_outcome(WIRES[path.parent.name][1], path.read_bytes()) == "refused"


def test_a_laser_box_whose_tokens_are_used_up_is_refused_before_anything_is_permitted() -> None:
    greeting = laserbox.encode(
        laserbox.Greeting(
            identity="box1", version=laserbox.VERSION, lease_ms=100, last_token=2**31 - 1, seen=0, meter=0
        )
    )
    with pytest.raises(NotConnectedError, match="has used the token 2147483647"):
        LaserBox(port=ScriptedPort(b"\0\0" + bytes([len(greeting)]) + greeting), clock=VirtualClock())


@pytest.mark.parametrize("turns", [3107, -3107])
def test_a_stage_too_far_from_home_for_any_target_to_be_encoded_is_refused(turns: int) -> None:
    clock = VirtualClock()
    # Half a turn more is beyond 32 bits.
    emulator = Kdc101Emulator(probe=SimpleNamespace(angle_deg=360.0 * turns))
    port = DirectPort(device=emulator, clock=clock)
    settings = Kdc101Settings(port="", zero_deg=0.0)
    with pytest.raises(MoveError, match="more than a thousand turns"):
        Kdc101Stage(port=port, clock=clock, settings=settings)


def test_other_files_and_a_link_that_leads_nowhere_are_no_channel_files(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    (tmp_path / "CH000.daq").symlink_to("nowhere")
    assert DaqFolder(tmp_path).state() == {}
