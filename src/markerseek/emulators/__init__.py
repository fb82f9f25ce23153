"""Emulators of the devices of a rig at the level of bytes, for drivers on a laptop and in tests.

Each emulator is a `ByteDevice`: bytes in, bytes out, and the time as an argument. `PtyLine` puts one behind a
pseudo-terminal for any program that opens a serial port.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
