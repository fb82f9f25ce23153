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


@pytest.fixture
def ring() -> Iterator[ImageRing]:
    made = ImageRing.create()
    assert made is not None
    with made:
        yield made


@given(
    numbers=st.lists(st.integers(1, 60), min_size=1, max_size=60, unique=True).map(sorted),
    shape=st.tuples(st.integers(1, 40), st.integers(1, 9)),
)
def test_the_newest_images_are_got_as_they_were_put_in(numbers: list[int], shape: tuple[int, int]) -> None:
    rows, columns = shape
    made = ImageRing.create()
    assert made is not None
    with made as ring:
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


@given(at=st.integers(0, 255), bit=st.integers(0, 7))
def test_an_image_with_one_wrong_bit_is_not_got(at: int, bit: int) -> None:
    made = ImageRing.create()
    assert made is not None
    with made as ring:
        ring.put(3, image_of(3))
        place = 3 * MAX_SLOT_BYTES + at % (20 + 8 * 12 + 4 * 35)
        (byte,) = os.pread(ring.fileno(), 1, place)
        os.pwrite(ring.fileno(), bytes([byte ^ 1 << bit]), place)
        assert ring.get(3) is None


@given(written=st.integers(0, 251))
def test_an_image_that_is_half_written_over_another_is_not_got(written: int) -> None:
    old, new = ImageRing.create(), ImageRing.create()
    assert old is not None
    assert new is not None
    with old, new:
        old.put(3, image_of(3))
        new.put(3 + SLOTS, image_of(3 + SLOTS))
        # As far as its process came before it was killed.
        os.pwrite(old.fileno(), os.pread(new.fileno(), written, 3 * MAX_SLOT_BYTES), 3 * MAX_SLOT_BYTES)
        assert old.get(3 + SLOTS) is None
        assert (old.get(3) is None) == (written > 0)


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
        ring = ImageRing.create()
        assert ring is not None
        with (
            ring,
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
                # Read while it is written: what comes is whole.
                number = int(last) if last.strip().isdigit() else 0
                for each in range(number, number + 4):
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
