"""A small process that holds the laser's line and the stage's, and lets go of them when the control loop is gone.

Cleanup code runs when a program is interrupted, and not when it is killed or hangs. The supervisor needs no cleanup of
the control process: it says each line's farewell when the socket closes, when the beat of the control loop is late
while the lease is held, and when it is told to end itself. It relays bytes and knows no device's language.
"""

from markerseek.supervisor.client import Supervisor
from markerseek.supervisor.lines import Line
from markerseek.supervisor.port import SupervisedPort

__all__ = ["Line", "SupervisedPort", "Supervisor"]
