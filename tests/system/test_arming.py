"""What a person types after the question arms a rig, and nothing else (safety.md, P16): on real pseudo-terminals."""

from __future__ import annotations

import os
import random
import re
import select
import subprocess
import sys
from collections.abc import Iterator

import pytest

from tests.emulated import emulation, markerseek, ran

pytestmark = pytest.mark.real_time

LONGEST_S = 120.0
SEARCH = ("--method", "weighted-average", "--as-published", "--acquisitions", "2", "--no-journal")

ASKS = """
import os, select, sys
from markerseek.cli.open_rig import confirmed
while (turn := os.read({turns}, 1)) == b"p" or turn == b"q":
    if turn == b"p" and select.select([0], [], [], 0)[0]:
        sys.stdin.buffer.peek()  # a line in Python's own buffer
    armed = confirmed("Arm the laser and search?", name="bench.toml", asked_by="nobody")
    sys.stderr.write("ARMED\\n" if armed else "REFUSED\\n")
    sys.stderr.flush()
"""


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    far, near = os.openpty()
    yield far, near
    os.close(far)
    os.close(near)


def said_until(wanted: str, pipe: int) -> str:
    """What a process says up to a text."""
    said = ""
    while wanted not in said:
        assert select.select([pipe], [], [], LONGEST_S)[0], f"{wanted!r} was not said: {said}"
        data = os.read(pipe, 1)
        assert data, f"it ended before {wanted!r}: {said}"
        said += data.decode()
    return said


def asking(near: int, *words: object) -> tuple[subprocess.Popen[bytes], str]:
    """A command on a terminal once it has asked for the name of the rig, and what it said."""
    process = subprocess.Popen(markerseek(*words), stdin=near, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stderr is not None
    return process, said_until("name of the rig: ", process.stderr.fileno())


def test_1000_early_keys_arm_nothing_and_the_name_typed_after_the_question_does(terminal: tuple[int, int]) -> None:
    """Keys, whole answers and parts of the right name, typed before: also what Python has read already."""
    far, near = terminal
    turns, turn = os.pipe()
    chance = random.Random(26)
    right = b"bench.toml\n"
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", ASKS.format(turns=turns)],
        stdin=near,
        stderr=subprocess.PIPE,
        pass_fds=(turns,),
    )
    assert process.stderr is not None
    pipe = process.stderr.fileno()
    keys = 0
    armed = 0
    asked = 0
    with process.stderr:
        while keys < 1000:
            early = chance.choice(
                [b"y\n", b"yes\n", right, right[:5], b"y", b"\n", right + right, bytes([chance.randrange(97, 123)])]
            )
            answer = chance.choice([b"\n", b"y\n", b"yes\n", right[5:], right[:4] + b"\n", right])
            os.write(far, early)
            # They are there when the question comes.
            os.write(turn, chance.choice([b"p", b"q"]))
            said_until("name of the rig: ", pipe)
            os.write(far, answer)
            found = "ARMED" in said_until("ED\n", pipe)
            assert found == (answer == right), (early, answer)
            keys = keys + len(early)
            asked = asked + 1
            armed = armed + found
        os.close(turn)
        assert process.wait(LONGEST_S) == 0
    os.close(turns)
    assert asked > armed > 0


def test_what_was_typed_while_search_starts_arms_nothing(terminal: tuple[int, int], tmp_path) -> None:
    far, near = terminal
    with emulation(tmp_path) as devices:
        os.write(far, b"y\nrig.toml\n")
        process, said = asking(near, "search", "--rig", devices.rig, *SEARCH)
        assert re.search(r"asked by: .+, on this terminal\nArm the laser and search\? Only the name", said)
        assert said.count("rig.toml") == 1
        # Nothing typed before has answered it; nor does the letter.
        assert process.poll() is None
        os.write(far, b"y\n")
        process.communicate(timeout=LONGEST_S)
        assert process.returncode == 4
        assert devices.end() == (0.0, 0.0, 0)


def test_the_name_of_the_rig_arms_a_search(terminal: tuple[int, int], tmp_path) -> None:
    far, near = terminal
    with emulation(tmp_path) as devices:
        process, _ = asking(near, "search", "--rig", devices.rig, *SEARCH)
        os.write(far, b"rig.toml\n")
        process.communicate(timeout=LONGEST_S)
        assert process.returncode in (0, 3)
        assert devices.end()[2] > 0


def test_what_was_typed_before_resume_asks_continues_nothing(terminal: tuple[int, int], tmp_path, shell) -> None:
    far, near = terminal
    path = tmp_path / "run.journal"
    killed = "import os; from markerseek.scan import Scanner; Scanner.measure = lambda *_, **__: os._exit(9)\n"
    ran("search", "--journal", path, before=killed)
    for answer, code in ((b"\n", 4), (b"simulated rig\n", 0)):
        os.write(far, b"y\nsimulated rig\n")
        process, _ = asking(near, "resume", path)
        os.write(far, answer)
        process.communicate(timeout=LONGEST_S)
        assert process.returncode == code


def test_without_a_standard_input_nobody_is_asked(tmp_path) -> None:
    with emulation(tmp_path) as devices:
        ended = subprocess.run(
            ["sh", "-c", 'exec "$@" <&-', "sh", *markerseek("search", "--rig", devices.rig, *SEARCH)],
            capture_output=True,
            text=True,
            check=False,
        )
        assert ended.returncode == 4
        assert "not armed: nothing moved and nothing was fired" in ended.stderr
        assert devices.end() == (0.0, 0.0, 0)
