from .bench import EmulatedBench, ServingClock, require_pace, serve
from .byte_device import ByteDevice, DirectPort
from .kdc101 import Kdc101Settings
from .plus import EmulatedPlus
from .pty_line import PtyLine

__all__ = [
    "ByteDevice",
    "DirectPort",
    "EmulatedBench",
    "EmulatedPlus",
    "Kdc101Settings",
    "PtyLine",
    "ServingClock",
    "require_pace",
    "serve",
]
