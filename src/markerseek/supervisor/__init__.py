"""A separate process that holds the serial lines of laser and stage and makes both safe when the control loop fails.

Cleanup code runs when a program is interrupted, and not when it is killed or hangs. The supervisor needs no cleanup of
the control process: it sends each line's safe command when the socket closes, when the beat of the control loop is
late while the lease is held, and when it is terminated itself. It relays bytes and knows no device's protocol.
"""

from markerseek.supervisor.client import SupervisedPort, Supervisor

__all__ = ["SupervisedPort", "Supervisor"]
