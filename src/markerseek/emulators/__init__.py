"""The devices of a rig at the level of bytes, without the devices: what drivers talk to on a laptop and in tests.

Each emulator is a `ByteDevice`: bytes in, bytes out, time told to it. `PtyLine` puts one behind a pseudo-terminal for
any program that opens a serial port; `DirectPort` hands one to a driver in the same process, in virtual time.
"""

from markerseek.emulators.byte_device import ByteDevice, DirectPort
from markerseek.emulators.pty_line import PtyLine

__all__ = ["ByteDevice", "DirectPort", "PtyLine"]
