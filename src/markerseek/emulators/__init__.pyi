from .bench import EmulatedBench, require_pace, serve
from .kdc101 import Kdc101Settings
from .lines import ByteDevice, DirectPort, PtyLine
from .plus import EmulatedPlus

__all__ = [
    "ByteDevice",
    "DirectPort",
    "EmulatedBench",
    "EmulatedPlus",
    "Kdc101Settings",
    "PtyLine",
    "require_pace",
    "serve",
]
