"""``python -m markerseek.supervisor FD JSON``: started by `Supervisor`, not by hand."""

from __future__ import annotations

import socket
import sys

import msgspec

from markerseek.core import MarkerseekError
from markerseek.supervisor.death import hasten
from markerseek.supervisor.keeper import Keeper
from markerseek.supervisor.lines import Line
from markerseek.supervisor.messages import MOST_BYTES, Kind, packed


class _Orders(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    lines: tuple[Line, ...]
    period_s: float
    parent: int | None = None


def main() -> int:
    """Hold the lines that the control process names, until it is gone."""
    orders = msgspec.json.decode(sys.argv[2], type=_Orders)
    with socket.socket(fileno=int(sys.argv[1])) as control:
        try:
            keeper = Keeper(control, lines=orders.lines, period_s=orders.period_s, parent=orders.parent)
        except MarkerseekError as error:
            control.sendall(packed(Kind.FAILED, str(error).encode()[:MOST_BYTES]))
            return 1
        hasten()
        keeper.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
