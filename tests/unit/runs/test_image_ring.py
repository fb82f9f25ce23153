"""Images from one process to another: what is got is what was put in, or nothing, whatever happens in between."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from markerseek.core import ConfigError, PaImage
from markerseek.runs import ImageRing
from markerseek.runs.image_ring import MAX_SLOT_BYTES, SLOTS

needs_memory_files = pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="no files in memory without a name")
pytestmark = needs_memory_files


def image_of(number: int, *, rows: int = 7, columns: int = 5) -> PaImage:
    """The image of an entry, another one for each number."""
    rng = np.random.default_rng([number, rows, columns])
    return PaImage(
        envelope=rng.random((rows, columns), np.float32),
        lateral_m=np.linspace(-0.02, 0.02, columns) + number,
        depth_m=np.linspace(0.004, 0.08, rows) + number,
    )


def equal(one: PaImage, other: PaImage) -> bool:
    """Whether two images are the same to the bit."""
    return all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("envelope", "lateral_m", "depth_m")
    )


class Killed(BaseException):
    """The process is killed here."""


def made() -> ImageRing:
    """A new ring."""
    ring = ImageRing.create()
    assert ring is not None
    return ring


@pytest.fixture
def ring() -> Iterator[ImageRing]:
    with made() as empty:
        yield empty


@given(
    numbers=st.lists(st.integers(1, 60), min_size=1, max_size=60, unique=True).map(sorted),
    shape=st.tuples(st.integers(1, 40), st.integers(1, 9)),
)
def test_the_newest_images_are_got_as_they_were_put_in(numbers: list[int], shape: tuple[int, int]) -> None:
    rows, columns = shape
    with made() as ring:
        for number in numbers:
            ring.put(number, image_of(number, rows=rows, columns=columns))
        newest = {number % SLOTS: number for number in numbers}
        for number in range(1, 61):
            got = ring.get(number)
            if newest.get(number % SLOTS) == number:
                assert got is not None
                assert equal(got, image_of(number, rows=rows, columns=columns))
            else:
                assert got is None


@given(steps=st.integers(0, 2), at=st.integers(0, 243))
def test_an_image_that_is_not_whole_is_not_got(steps: int, at: int) -> None:
    with made() as ring, pytest.MonkeyPatch.context() as patched:
        ring.put(3, image_of(3))
        plain = os.pwrite
        plain_several = os.pwritev
        left = steps

        def number_is_written(descriptor: int, data: bytes, place: int) -> int:
            nonlocal left
            left -= 1
            if left < 0:
                raise Killed
            return plain(descriptor, data, place)

        def image_is_written(descriptor: int, parts: list[memoryview], place: int) -> int:
            nonlocal left
            left -= 1
            if left < 0:
                plain(descriptor, b"".join(parts)[:at], place)
                raise Killed
            return plain_several(descriptor, parts, place)

        patched.setattr(os, "pwrite", number_is_written)
        patched.setattr(os, "pwritev", image_is_written)
        with pytest.raises(Killed):
            ring.put(3 + SLOTS, image_of(3 + SLOTS))
        assert ring.get(3 + SLOTS) is None
        assert (ring.get(3) is None) == (steps > 0)


def test_an_image_over_which_another_is_written_meanwhile_is_not_got(
    ring: ImageRing, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = os.pread
    calls = []

    def read(descriptor: int, size: int, place: int) -> bytes:
        calls.append(size)
        if len(calls) == 2:
            monkeypatch.undo()
            ring.put(3 + SLOTS, image_of(3 + SLOTS))
        return plain(descriptor, size, place)

    ring.put(3, image_of(3))
    monkeypatch.setattr(os, "pread", read)
    assert ring.get(3) is None
    assert len(calls) == 2
    got = ring.get(3 + SLOTS)
    assert got is not None
    assert equal(got, image_of(3 + SLOTS))


def test_an_image_for_which_there_is_half_the_room_is_not_got(ring: ImageRing, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = os.pwritev
    monkeypatch.setattr(os, "pwritev", lambda descriptor, parts, place: plain(descriptor, parts[:-1], place))
    ring.put(3, image_of(3))
    assert ring.get(3) is None


def test_a_reader_that_never_reads_costs_no_more_memory_than_its_places(ring: ImageRing) -> None:
    image = image_of(1, rows=990, columns=128)
    for number in range(1, 10 * SLOTS):
        ring.put(number, image)
    held = os.fstat(ring.fileno()).st_blocks * 512
    assert held <= SLOTS * (image.envelope.nbytes + 64 * 1024)


def test_an_image_that_is_too_large_is_not_handed_on_and_the_others_are(ring: ImageRing) -> None:
    ring.put(1, image_of(1, rows=MAX_SLOT_BYTES // 4, columns=1))
    assert ring.get(1) is None
    assert os.fstat(ring.fileno()).st_size == 0
    ring.put(2, image_of(2))
    assert ring.get(2) is not None


def test_no_room_is_no_error_of_the_search() -> None:
    with ImageRing(os.open("/dev/full", os.O_RDWR)) as ring:
        with pytest.raises(OSError, match="No space left"):
            os.pwrite(ring.fileno(), b"x", 0)
        ring.put(1, image_of(1))


@pytest.mark.parametrize("what", ["a file with a name", "a pipe", "nothing"])
def test_only_a_file_without_a_name_is_written_to(tmp_path: Path, what: str) -> None:
    path = tmp_path / "patient.dcm"
    reader, writer = os.pipe()
    if what == "a file with a name":
        path.write_bytes(b"an image of a patient")
    elif what == "a pipe":
        path = Path(f"/dev/fd/{reader}")
    with pytest.raises(ConfigError, match="images"):
        ImageRing.open(path)
    os.close(reader)
    os.close(writer)
    if what == "a file with a name":
        assert path.read_bytes() == b"an image of a patient"


WRITER = """
import sys
from pathlib import Path
from markerseek.runs import ImageRing
from tests.unit.runs.test_image_ring import image_of
ring = ImageRing.open(Path(sys.argv[1]))
image = [image_of(number, rows=990, columns=128) for number in range(8)]
print("ready", flush=True)
number = 0
while True:
    number += 1
    ring.put(number, image[number % 8])
    if number % 64 == 0:
        print(number, flush=True)
"""


@pytest.mark.real_time
@pytest.mark.long
def test_a_writer_that_is_killed_at_any_time_leaves_whole_images_or_none() -> None:
    images = [image_of(number, rows=990, columns=128) for number in range(8)]
    got = 0

    @given(lines=st.integers(1, 12), more_s=st.floats(0, 0.003))
    # Not shrunk: each example is a process.
    @settings(max_examples=15, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
    def killed(lines: int, more_s: float) -> None:
        nonlocal got
        with (
            made() as ring,
            subprocess.Popen(
                [sys.executable, "-c", WRITER, f"/dev/fd/{ring.fileno()}"],
                pass_fds=[ring.fileno()],
                stdout=subprocess.PIPE,
                text=True,
            ) as writer,
        ):
            assert writer.stdout is not None
            last = ""
            for _ in range(lines + 1):
                last = writer.stdout.readline()
                # Read while it is written, some behind it and some where it writes: what comes is whole.
                number = int(last) if last.strip().isdigit() else 0
                for each in range(max(1, number - SLOTS), number + SLOTS):
                    image = ring.get(each)
                    assert image is None or equal(image, images[each % 8])
            try:
                writer.wait(more_s)
            except subprocess.TimeoutExpired:
                writer.send_signal(signal.SIGKILL)
            writer.wait()
            for number in range(1, int(last) + 10_000):
                image = ring.get(number)
                assert image is None or equal(image, images[number % 8])
                got += image is not None

    killed()
    assert got > 15 * (SLOTS - 2)
