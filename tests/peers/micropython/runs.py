"""Random steps for a laser box, and the emulator's answers and pulses: ``python runs.py FILE``."""

from __future__ import annotations

import json
import random
import sys
from pathlib import Path

from markerseek.core import FrameHeader, ReadingFrame
from markerseek.emulators.laserbox import EmulatedLaserBox
from markerseek.sim import Flash
from markerseek.wire import laserbox as wire

RUNS = 400
STEPS = 25


class Dark:
    """A world in which nothing sounds."""

    angle_deg = 0.0

    def __init__(self) -> None:
        self.flashes: list[Flash] = []

    def flash(self, *, pulses: int, at_s: float) -> None:
        self.flashes.append(Flash(at_s=at_s, pulses=pulses, energy=1.0))

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> ReadingFrame:
        return ReadingFrame(header=header, intensity=0.0)


def permit(rng: random.Random) -> wire.PermitPulses:
    pulses = rng.randint(0, 12)
    return wire.PermitPulses(
        token=rng.randint(1, 8),
        pulses=pulses,
        rate_hz=rng.choice([10, 20, 50, 100, 200, 500]),
        expiry_ms=rng.randint(1, 300),
        triggers=max(1, pulses + rng.randint(0, 3)),
    )


def sweep(rng: random.Random) -> wire.PermitSweep:
    return wire.PermitSweep(
        token=rng.randint(1, 8),
        pulses=rng.randint(1, 12),
        period_us=1000 * rng.randint(2, 40),
        expiry_ms=rng.randint(1, 300),
    )


def command(rng: random.Random) -> bytes:
    allowed = permit(rng)
    text = "".join(rng.choices("ABDEFHILMOPRSTKN 0123456789*-", k=rng.randint(0, 20))).encode()
    return rng.choice(
        [
            wire.encode(wire.Hello()),
            wire.encode(wire.Disarm()),
            wire.encode(wire.Beat(step=rng.randint(1, 30))),
            wire.encode(wire.Beat(step=rng.randint(1, 30))),
            wire.encode(wire.Fire(token=rng.randint(1, 8))),
            wire.encode(allowed),
            wire.encode(allowed) + wire.encode(wire.Fire(token=allowed.token)),
            wire.encode(wire.AskTime(number=rng.randint(0, 3))),
            wire.encode(sweep(rng)) + wire.encode(wire.Fire(token=allowed.token)),
            rng.randbytes(rng.randint(0, 90)),
            text + b"*%04X\n" % wire.crc16(text),
        ]
    )


def one_run(rng: random.Random) -> dict[str, object]:
    box = EmulatedLaserBox(world=Dark(), on_triggers=lambda _count: None, turn_us=1000)
    steps: list[tuple[str, object]] = []
    said: list[bytes] = []
    now_ms = 0
    closed = True
    for _ in range(STEPS):
        match rng.choices(["feed", "ms", "interlock", "flick", "light"], weights=[12, 6, 2, 1, 1])[0]:
            case "feed":
                data = command(rng)
                steps.append(("feed", data.hex()))
                said.append(box.feed(data))
            case "ms":
                times_ms = range(now_ms + 1, now_ms + 1 + rng.randint(1, 120))
                now_ms = times_ms[-1]
                steps.append(("ms", len(times_ms)))
                said.append(b"".join(box.advance(at_ms / 1e3) for at_ms in times_ms))
            case "flick":
                box.open_interlock()
                if closed:
                    box.close_interlock()
                steps.append(("flick", 0))
                said.append(b"")
            case "light":
                box.stray_light()
                steps.append(("light", 0))
                said.append(b"")
            case _:
                closed = not closed
                (box.close_interlock if closed else box.open_interlock)()
                steps.append(("interlock", closed))
                said.append(box.advance(now_ms / 1e3))
    # every train is completed, lit or not
    steps.append(("ms", 2000))
    said.append(b"".join(box.advance(at_ms / 1e3) for at_ms in range(now_ms + 1, now_ms + 2001)))
    pulses_ms = [round(1e3 * pulse.at_s) for pulse in box.pulses]
    return {"steps": steps, "said": [answer.hex() for answer in said], "pulses_ms": pulses_ms}


if __name__ == "__main__":
    generator = random.Random(1)
    Path(sys.argv[1]).write_text(json.dumps([one_run(generator) for _ in range(RUNS)]))
