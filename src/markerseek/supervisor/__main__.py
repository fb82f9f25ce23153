"""Entry point of the supervisor process: ``python -m markerseek.supervisor FD JSON``, started by `Supervisor`."""

from __future__ import annotations

import socket
import sys

import msgspec

from markerseek.core import MarkerseekError
from markerseek.files import Line
from markerseek.supervisor.messages import MAX_BYTES, Kind, packed
from markerseek.supervisor.process import SupervisorProcess, set_realtime_priority


class _Arguments(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    lines: tuple[Line, ...]
    period_s: float
    parent: int | None = None


def main() -> int:
    """Hold the lines that the control process names, until it is gone."""
    arguments = msgspec.json.decode(sys.argv[2], type=_Arguments)
    with socket.socket(fileno=int(sys.argv[1])) as control:
        try:
            process = SupervisorProcess(
                control, lines=arguments.lines, period_s=arguments.period_s, parent=arguments.parent
            )
        except MarkerseekError as error:
            control.sendall(packed(Kind.FAILED, str(error).encode()[:MAX_BYTES]))
            return 1
        set_realtime_priority()
        process.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
