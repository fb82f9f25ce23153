from .bench import ByteDevice, EmulatedBench, PtyLine, serve_bench
from .endoscope import EmulatedEndoscope
from .kdc101 import EmulatedKdc101
from .laserbox import LIGHT_COUNTS
from .receivers import EmulatedPlus, EmulatedSonixDaq, EmulatedVantage

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
    "serve_bench",
]
