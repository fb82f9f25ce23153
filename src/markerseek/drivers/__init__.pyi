from ._kdc101_settings import Kdc101Keys
from ._plus_settings import PlusSettings
from ._ros2_settings import Ros2StageSettings, RosLaser, RosReceiver
from ._sonixdaq_settings import SonixDaqKeys
from .clock import LONGEST_WAIT_S, SystemClock
from .energy_meter import EnergyMeter, metered
from .exposure import exposure_line
from .kdc101 import Kdc101DriverSettings, Kdc101Stage
from .laserbox import LaserBox
from .plus import PlusReceiver, connect_plus
from .ros2_acquisition import Ros2Acquisition
from .ros2_stage import Ros2Stage
from .serial_port import SerialPort
from .settings import BenchLaser, BenchProbe, BenchReceiver, BenchSettings
from .sonixdaq import SonixDaqReceiver, SonixDaqSettings

__all__ = [
    "LONGEST_WAIT_S",
    "BenchLaser",
    "BenchProbe",
    "BenchReceiver",
    "BenchSettings",
    "EnergyMeter",
    "Kdc101DriverSettings",
    "Kdc101Keys",
    "Kdc101Stage",
    "LaserBox",
    "PlusReceiver",
    "PlusSettings",
    "Ros2Acquisition",
    "Ros2Stage",
    "Ros2StageSettings",
    "RosLaser",
    "RosReceiver",
    "SerialPort",
    "SonixDaqKeys",
    "SonixDaqReceiver",
    "SonixDaqSettings",
    "SystemClock",
    "connect_plus",
    "exposure_line",
    "metered",
]
