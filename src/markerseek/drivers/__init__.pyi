from .clock import SLICE_S, SystemClock
from .exposure import exposure_line
from .kdc101 import Kdc101Stage, StageSettings
from .laserbox import LaserBox
from .serial_port import SerialPort, SerialSettings
from .settings import BenchProbe, BenchSettings, SonixDaqKeys, StageKeys
from .sonixdaq import SonixDaqReceiver, SonixDaqSettings

__all__ = [
    "SLICE_S",
    "BenchProbe",
    "BenchSettings",
    "Kdc101Stage",
    "LaserBox",
    "SerialPort",
    "SerialSettings",
    "SonixDaqKeys",
    "SonixDaqReceiver",
    "SonixDaqSettings",
    "StageKeys",
    "StageSettings",
    "SystemClock",
    "exposure_line",
]
