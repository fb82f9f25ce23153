from ._kdc101_settings import StageKeys
from ._plus_settings import PlusSettings
from ._ros2_settings import RosLaser, RosReceiver, RosStage
from ._sonixdaq_settings import SonixDaqKeys
from .clock import SLICE_S, SystemClock
from .exposure import exposure_line
from .kdc101 import Kdc101Stage, StageSettings
from .laserbox import LaserBox
from .plus import PlusReceiver, connect_plus
from .ros2_acquisition import Ros2Acquisition
from .ros2_stage import Ros2Stage
from .serial_port import SerialPort
from .settings import BenchLaser, BenchProbe, BenchReceiver, BenchSettings
from .sonixdaq import SonixDaqReceiver, SonixDaqSettings

__all__ = [
    "SLICE_S",
    "BenchLaser",
    "BenchProbe",
    "BenchReceiver",
    "BenchSettings",
    "Kdc101Stage",
    "LaserBox",
    "PlusReceiver",
    "PlusSettings",
    "Ros2Acquisition",
    "Ros2Stage",
    "RosLaser",
    "RosReceiver",
    "RosStage",
    "SerialPort",
    "SonixDaqKeys",
    "SonixDaqReceiver",
    "SonixDaqSettings",
    "StageKeys",
    "StageSettings",
    "SystemClock",
    "connect_plus",
    "exposure_line",
]
