"""OpenIGTLink messages against the checksums of the standard's own test messages, pyigtl, and damaged bytes."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pyigtl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.core import ConfigError, DeviceError
from markerseek.wire import igtl
from tests.sizes import examples

MAX_BYTES = 1 << 24


def decoded(data: bytes) -> igtl.Message:
    header = igtl.decode_header(data[: igtl.HEADER_BYTES], most_bytes=MAX_BYTES)
    return igtl.decode(header, data[igtl.HEADER_BYTES :])


def refusal(decode: Callable[[], igtl.Message]) -> str | None:
    """Sentence with which it is refused; any other error comes through."""
    try:
        decode()
    except DeviceError as problem:
        return str(problem)
    return None


def floats(words: str) -> tuple[float, ...]:
    return struct.unpack(f">{len(words.split())}f", bytes.fromhex(words))


def matrix_of(values: tuple[float, ...]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3] = np.array(values).reshape(4, 3).T
    return matrix


_PLACE = floats("42383660 419BC467 42383660")
_METADATA = {"First patient age": "22", "Second patient age": "25"}
# Contents and CRC of the test messages of the OpenIGTLink library (Testing/igtlutil/igtl_test_data_*.h, 3.1).
PUBLISHED = [
    (
        igtl.Transform(
            matrix=matrix_of(
                floats("BF7473CD 3E4959E6 BE63DD98 BE4959E6 3E12491B 3F7852D6 3E63DD98 3F7852D6 BDC830AE") + _PLACE
            )
        ),
        1,
        0xF6DD2B8EB4DF6DD2,
    ),
    (igtl.Text(text="Welcome to OpenIGTLink"), 1, 0xCEF1B42A701104D4),
    (
        igtl.Status(code=15, subcode=10, name="ACTUATOR_DISABLED", message="Actuator A is disabled."),
        1,
        0x98EE43EED8E431CF,
    ),
    (
        igtl.Position(position_mm=_PLACE, quaternion=floats("00000000 3F13CD3A 3F13CD3A 3EAAAAAB")),
        2,
        0xC71116427681C1E2,
    ),
    (igtl.Command(number=5, name="This is a test command", text="Start the tracking machine"), 2, 0x85D25EE941901770),
]


@pytest.mark.parametrize(("content", "version", "crc"), PUBLISHED, ids=lambda each: getattr(each, "kind", None))
def test_the_checksum_is_that_of_the_same_message_in_the_tests_of_the_library(
    content: igtl.Content, version: int, crc: int
) -> None:
    data = igtl.encode(igtl.Message(device="DeviceName", content=content, metadata=_METADATA, version=version))
    header = igtl.decode_header(data[: igtl.HEADER_BYTES], most_bytes=MAX_BYTES)
    body = data[igtl.HEADER_BYTES :]
    if version == 2:
        # Their messages have the id 1, ours none.
        body = body[:8] + struct.pack(">I", 1) + body[12:]
        data = data[: igtl.HEADER_BYTES] + body
        header = replace(header, crc=crc)
    assert header.crc == crc
    assert igtl.decode(header, body).metadata == ({} if version == 1 else _METADATA)


_RAMP = np.arange(24, dtype=np.int16).reshape(1, 4, 6)
_MATRIX = np.array([[0.0, 0, 1, -3], [0.2, 0, 0, -19], [0, 0.1, 0, 10], [0, 0, 0, 1]])


def test_pyigtl_reads_what_is_sent() -> None:
    def read(content: igtl.Content) -> pyigtl.messages.MessageBase:
        data = igtl.encode(
            igtl.Message(device="PaMarker", content=content, time_s=1.75e9 + 0.125, metadata={"sequence": "7"})
        )
        fields = pyigtl.messages.MessageBase.parse_header(data[: igtl.HEADER_BYTES])
        message = pyigtl.messages.MessageBase.create_message(fields["message_type"])
        message.unpack(fields, data[igtl.HEADER_BYTES :])
        assert message.metadata == {"sequence": "7"}
        assert message.device_name == "PaMarker"
        assert message.timestamp == pytest.approx(1.75e9 + 0.125, abs=1e-6)
        return message

    assert read(igtl.Transform(matrix=_MATRIX)).matrix == pytest.approx(_MATRIX)
    assert read(igtl.Text(text="found at 1.25°")).string == "found at 1.25°"
    image = read(igtl.Image(pixels=_RAMP, matrix=_MATRIX))
    assert (image.image == _RAMP).all()
    assert image.ijk_to_world_matrix == pytest.approx(_MATRIX)
    assert image.world_coordinate_system == "ras"
    points = read(igtl.Points(points=(igtl.Point(name="marker", group="simulated", position_mm=(1, 2, 3)),)))
    assert (points.names, points.groups, points.positions) == (["marker"], ["simulated"], [(1, 2, 3)])


def test_what_pyigtl_sends_is_read() -> None:
    made = pyigtl.ImageMessage(_RAMP, _MATRIX, "lps", timestamp=5.5, device_name="Rf")
    made.header_version = 2
    made.metadata = {"ProbeToProbeHomeTransformStatus": "OK"}
    message = decoded(made.pack())
    assert isinstance(message.content, igtl.Image)
    assert message.content.pixels.tolist() == _RAMP.tolist()
    assert message.content.pixels.dtype == np.int16
    assert message.content.matrix == pytest.approx(_MATRIX)
    assert (message.content.system, message.time_s, message.metadata) == ("lps", 5.5, made.metadata)


FLOAT32 = st.floats(-1e6, 1e6, width=32)
TRIPLE = st.tuples(FLOAT32, FLOAT32, FLOAT32)
TEXT = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=15)
CONTENTS = st.one_of(
    st.just(igtl.Points(points=())),
    st.lists(FLOAT32, min_size=12, max_size=12).map(lambda values: igtl.Transform(matrix=matrix_of(tuple(values)))),
    st.just(igtl.Transform(matrix=None)),
    st.builds(igtl.Text, text=TEXT),
    st.builds(igtl.Position, position_mm=st.none() | TRIPLE, quaternion=st.tuples(FLOAT32, FLOAT32, FLOAT32, FLOAT32)),
    st.builds(igtl.Status, code=st.integers(0, 65535), subcode=st.integers(-(1 << 63), (1 << 63) - 1), message=TEXT),
    st.builds(igtl.Command, number=st.integers(0, 2**32 - 1), name=TEXT, text=TEXT),
    st.builds(igtl.Reply, number=st.integers(0, 2**32 - 1), name=TEXT, text=TEXT),
    st.builds(
        igtl.Image,
        pixels=st.tuples(st.integers(1, 3), st.integers(1, 5), st.integers(1, 5)).map(
            lambda shape: np.arange(np.prod(shape), dtype=np.float32).reshape(shape)
        ),
        matrix=st.just(_MATRIX),
    ),
)


@given(CONTENTS, st.dictionaries(TEXT, TEXT, max_size=3), st.sampled_from([1, 2]))
def test_a_message_is_read_as_it_was_written(content: igtl.Content, metadata: dict[str, str], version: int) -> None:
    message = decoded(igtl.encode(igtl.Message(device="a", content=content, metadata=metadata, version=version)))
    assert message.metadata == (metadata if version == 2 else {})
    if isinstance(content, igtl.Transform):
        assert np.array_equal(message.content.matrix, content.matrix)
    elif isinstance(content, igtl.Image):
        assert (message.content.pixels == content.pixels).all()
        assert message.content.matrix == pytest.approx(content.matrix)
    else:
        assert message.content == content


@settings(max_examples=examples(300))
@given(CONTENTS, st.sampled_from([1, 2]), st.data())
def test_damaged_bytes_are_refused_with_a_sentence(content: igtl.Content, version: int, data: st.DataObject) -> None:
    whole = bytearray(igtl.encode(igtl.Message(device="a", content=content, version=version)))
    at = data.draw(st.integers(0, len(whole) - 1))
    whole[at] ^= data.draw(st.integers(1, 255))
    in_stamp_or_names = 2 <= at < 42
    said = refusal(lambda: decoded(bytes(whole)))
    # The checksum does not cover the header.
    assert in_stamp_or_names if said is None else said.startswith("OpenIGTLink: ")


@settings(max_examples=examples(500))
@given(st.sampled_from(igtl.KINDS), st.binary(max_size=200), st.sampled_from([1, 2]))
def test_any_body_with_the_right_checksum_is_read_or_refused(kind: str, body: bytes, version: int) -> None:
    header = igtl.Header(
        version=version, kind=kind, device="a", time_s=0.0, body_bytes=len(body), crc=pyigtl.messages.CRC64(body)
    )
    said = refusal(lambda: igtl.decode(header, body))
    assert said is None or said.startswith(f"OpenIGTLink: {kind} 'a': ")


def test_a_wrong_checksum_names_both() -> None:
    data = bytearray(igtl.encode(igtl.Message(device="a", content=igtl.Text(text="x"))))
    data[-1] ^= 1
    with pytest.raises(DeviceError, match=r"its CRC is [0-9A-F]{16}, that of what came is [0-9A-F]{16}; send it again"):
        decoded(bytes(data))


def test_a_matrix_with_nan_is_refused_both_ways() -> None:
    with pytest.raises(ConfigError, match="finite"):
        igtl.Transform(matrix=_MATRIX * np.nan)
    body = struct.pack(">12f", *[float("nan")] * 11, 1.0)
    header = igtl.Header(
        version=1, kind="TRANSFORM", device="a", time_s=0.0, body_bytes=48, crc=pyigtl.messages.CRC64(body)
    )
    with pytest.raises(DeviceError, match=r"OpenIGTLink: TRANSFORM 'a': .* finite"):
        igtl.decode(header, body)


@pytest.mark.parametrize("numbers", [[float("nan"), 0, 0], [0, 0, 0, float("nan"), 0, 0]])
def test_a_position_that_is_partly_nan_is_refused(numbers: list[float]) -> None:
    body = struct.pack(f">{len(numbers)}f", *numbers)
    header = igtl.Header(
        version=1, kind="POSITION", device="a", time_s=0.0, body_bytes=len(body), crc=pyigtl.messages.CRC64(body)
    )
    with pytest.raises(DeviceError, match=r"OpenIGTLink: POSITION 'a': .* finite"):
        igtl.decode(header, body)


def test_no_marker_is_an_empty_list_or_for_old_libraries_a_point_without_a_place_and_colour() -> None:
    data = igtl.encode(igtl.Message(device="PaMarker", content=igtl.Points(points=()), version=1))
    name, group, *rest = struct.unpack(">64s32s4B4f20s", data[igtl.HEADER_BYTES :])
    assert (name.rstrip(b"\0"), group.rstrip(b"\0"), rest[:4]) == (b"none", b"Unselected", [0, 0, 0, 0])
    assert all(map(math.isnan, rest[4:7]))
    # The library from OpenIGTLink 3 on takes the body of version 2 for whole only with metadata.
    message = igtl.Message(device="PaMarker", content=igtl.Points(points=()), metadata={"sequence": "1"})
    assert decoded(igtl.encode(message)).content == igtl.Points(points=())


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: igtl.Message(device="a" * 21, content=igtl.Text(text="")), "20 characters"),
        (lambda: igtl.Message(device="ä", content=igtl.Text(text="")), "ASCII"),
        (lambda: igtl.Message(device="a", content=igtl.Text(text=""), time_s=float("nan")), "time_s is nan"),
        (lambda: igtl.Text(text="ä" * 40_000), "80000 bytes, it may have 65535"),
        (lambda: igtl.Status(code=70_000), "code is 70000"),
        (lambda: igtl.Command(number=-1, name="", text=""), "number is -1"),
        (lambda: igtl.Image(pixels=np.zeros((4, 4), np.uint8), matrix=np.eye(4)), "slices, rows, columns"),
        (lambda: igtl.Image(pixels=np.zeros((1, 4, 4), np.int64), matrix=np.eye(4)), "int64"),
        (lambda: igtl.Point(name="a" * 65, group="", position_mm=(0, 0, 0)), "65 bytes, it may have 64"),
        (lambda: igtl.Point(name="a", group="", position_mm=(0, float("inf"), 0)), "finite"),
    ],
)
def test_what_cannot_be_sent_is_refused_when_it_is_made(make: object, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        make()


@given(st.lists(st.integers(0, 300), max_size=6))
def test_messages_come_out_whole_however_the_bytes_are_cut(cuts: list[int]) -> None:
    sent = [igtl.Message(device=name, content=igtl.Text(text=name)) for name in ("one", "", "three")]
    whole = [igtl.encode(message) for message in sent]
    stream = b"".join(whole)
    ends = [0, *sorted(cuts), len(stream)]
    framer = igtl.Framer(most_bytes=100)
    taken = []
    for start, end in pairwise(ends):
        taken += [len(body) for _, body in framer.feed(stream[start:end])]
    assert taken == [len(message) - igtl.HEADER_BYTES for message in whole]


def test_a_message_that_is_too_long_is_refused_at_its_header() -> None:
    data = igtl.encode(igtl.Message(device="a", content=igtl.Text(text="x")))
    huge = data[:42] + struct.pack(">Q", 1 << 60) + data[50:58]
    with pytest.raises(DeviceError, match="a body of 1152921504606846976 bytes, at most 65536 are taken; send less"):
        list(igtl.Framer(most_bytes=65536).feed(huge))
