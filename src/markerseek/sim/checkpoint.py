"""The state of a simulated world, kept and put back: a real one outlives the program, this one dies with it.

Not kept: what settings and seed say already, and the flashes of the past, which only tests look at.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec
import numpy as np

from markerseek.core import RecordError
from markerseek.sim.clock import VirtualClock
from markerseek.sim.receiver import SimulatedReceiver
from markerseek.sim.stage import SimulatedStage
from markerseek.sim.world import Surroundings


class _Generator(msgspec.Struct, frozen=True, kw_only=True):
    """State of NumPy's usual generator; its words of 128 bits are written in hexadecimal."""

    kind: Literal["PCG64"]
    state: str
    increment: str
    has_half: int
    half: int

    @classmethod
    def of(cls, rng: np.random.Generator) -> _Generator:
        """State of a generator now."""
        state: dict[str, Any] = dict(rng.bit_generator.state)
        words = state["state"]
        return cls(
            kind=state["bit_generator"],
            state=hex(words["state"]),
            increment=hex(words["inc"]),
            has_half=state["has_uint32"],
            half=state["uinteger"],
        )

    def put_into(self, rng: np.random.Generator) -> None:
        """Let a generator go on from here."""
        rng.bit_generator.state = {
            "bit_generator": self.kind,
            "state": {"state": int(self.state, 16), "inc": int(self.increment, 16)},
            "has_uint32": self.has_half,
            "uinteger": self.half,
        }


class _Checkpoint(msgspec.Struct, frozen=True, kw_only=True):
    """Time, the stage's encoder, where the probe truly points, the receiver's last number, and chance."""

    now_s: float
    encoder_counts: int
    probe_deg: float
    sequence: int
    generator: _Generator


class SimulatedState:
    """Everything of a simulated rig that changes during a search.

    Parameters
    ----------
    world, clock, stage, receiver
        The rig.
    rng
        The source of all its randomness.
    """

    def __init__(
        self,
        *,
        world: Surroundings,
        clock: VirtualClock,
        stage: SimulatedStage,
        receiver: SimulatedReceiver,
        rng: np.random.Generator,
    ) -> None:
        self._world = world
        self._rng = rng
        self._clock = clock
        self._stage = stage
        self._receiver = receiver

    def checkpoint(self) -> bytes:
        """State now, as JSON."""
        return msgspec.json.encode(
            _Checkpoint(
                now_s=self._clock.now_s(),
                encoder_counts=self._stage.counts,
                probe_deg=self._world.angle_deg,
                sequence=self._receiver.sequence,
                generator=_Generator.of(self._rng),
            )
        )

    def restore(self, checkpoint: bytes) -> None:
        """Go back to a state.

        Raises
        ------
        RecordError
            If it is none; nothing was changed.
        """
        try:
            state = msgspec.json.decode(checkpoint, type=_Checkpoint)
            state.generator.put_into(self._rng)
        except (msgspec.MsgspecError, ValueError, OverflowError) as problem:
            raise RecordError(f"the checkpoint of the simulated world cannot be read: {problem}") from problem
        self._clock.put_back(state.now_s)
        self._stage.counts = state.encoder_counts
        self._world.angle_deg = state.probe_deg
        self._receiver.sequence = state.sequence
