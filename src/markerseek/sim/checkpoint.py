"""Checkpoints of a simulated rig, so that a killed search can be resumed: a real rig outlives the program.

Not kept: settings and seed, which the journal holds, and the past flashes, which only tests read.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec
import numpy as np

from markerseek.core import RecordError
from markerseek.sim.clock import VirtualClock
from markerseek.sim.receiver import SimulatedReceiver
from markerseek.sim.stage import SimulatedStage
from markerseek.sim.world import SimulatedWorld


class _Generator(msgspec.Struct, frozen=True, kw_only=True):
    """State of NumPy's PCG64; its 128-bit words are hexadecimal, because JSON readers round large integers."""

    kind: Literal["PCG64"]
    state: str
    increment: str
    # PCG64 gives two draws of 32 bits from one of 64; a half that was not used yet is part of the state.
    has_half: int
    half: int

    @classmethod
    def of(cls, rng: np.random.Generator) -> _Generator:
        """Current state of a generator."""
        state: dict[str, Any] = dict(rng.bit_generator.state)
        words = state["state"]
        return cls(
            kind=state["bit_generator"],
            state=hex(words["state"]),
            increment=hex(words["inc"]),
            has_half=state["has_uint32"],
            half=state["uinteger"],
        )

    def restore(self, rng: np.random.Generator) -> None:
        """Set a generator to this state."""
        rng.bit_generator.state = {
            "bit_generator": self.kind,
            "state": {"state": int(self.state, 16), "inc": int(self.increment, 16)},
            "has_uint32": self.has_half,
            "uinteger": self.half,
        }


class _Checkpoint(msgspec.Struct, frozen=True, kw_only=True):
    """Time, the stage's encoder, the true angle of the probe, the receiver's last frame number, random state."""

    now_s: float
    # Both angles: with play the probe is not where the encoder says, and the difference depends on the last move.
    encoder_counts: int
    probe_deg: float
    sequence: int
    generator: _Generator


class SimulatedState:
    """Everything of a simulated rig that changes during a search."""

    def __init__(
        self,
        *,
        world: SimulatedWorld,
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
        """Current state as JSON."""
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
        """Set the rig to a state.

        Raises `RecordError` if it cannot be read; then nothing is changed.
        """
        try:
            state = msgspec.json.decode(checkpoint, type=_Checkpoint)
            # The only assignment that can fail comes first, so that a damaged checkpoint changes nothing.
            state.generator.restore(self._rng)
        except (msgspec.MsgspecError, ValueError, OverflowError) as problem:
            raise RecordError(f"the checkpoint of the simulated world cannot be read: {problem}") from problem
        self._clock.set(state.now_s)
        self._stage.counts = state.encoder_counts
        self._world.angle_deg = state.probe_deg
        self._receiver.sequence = state.sequence
