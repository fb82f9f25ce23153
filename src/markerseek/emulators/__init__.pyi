from .bench import EmulatedBench, serve
from .endoscope import EmulatedEndoscope
from .kdc101 import EmulatedKdc101
from .laserbox import LIGHT_COUNTS
from .lines import ByteDevice, PtyLine
from .senders import EmulatedPlus, EmulatedVantage
from .sonixdaq import EmulatedSonixDaq

__all__ = [
    "LIGHT_COUNTS",
    "ByteDevice",
    "EmulatedBench",
    "EmulatedEndoscope",
    "EmulatedKdc101",
    "EmulatedPlus",
    "EmulatedSonixDaq",
    "EmulatedVantage",
    "PtyLine",
    "serve",
]
