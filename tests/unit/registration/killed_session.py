"""A simulated session that continues itself, and kills itself after a step: ``killed_session.py FOLDER STEP NAME``.

``search`` as the step is the middle of a search; without a step it goes on to its end, and prints what only a
simulation knows.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import closing
from pathlib import Path

import msgspec

from markerseek.registration import (
    RegistrationSession,
    Searching,
    SessionPlan,
    SessionRecord,
    SimulatedRoom,
    SimulatedRoomSettings,
)
from tests.registration_sessions import BEGUN

SEED = 5


def main() -> None:
    folder, *wanted = sys.argv[1:]
    room = SimulatedRoom(SimulatedRoomSettings(), seed=SEED)
    known = Path(folder, "session.jsonl").exists()
    opened = SessionRecord.reopen(Path(folder)) if known else SessionRecord.create(Path(folder), BEGUN)
    with closing(opened) as record:
        room.skip(record.view.markers)
        session = RegistrationSession(room, plan=SessionPlan(markers=3), record=record)
        for step in session.steps():
            middle = isinstance(step, Searching) and len(step.view.samples) == 3
            kind = "search" if middle else type(step).__name__
            if [kind, getattr(step, "name", str(len(session.view.markers)))] == wanted:
                os.kill(os.getpid(), signal.SIGKILL)
        truth = room.truth(session.view)
    sys.stdout.write(msgspec.json.encode(truth).decode())


if __name__ == "__main__":
    main()
