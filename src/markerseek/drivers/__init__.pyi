from ._ros2_acquisition import Ros2Acquisition, Ros2ReceiverSettings
from ._stage_rules import StageLogic, StageRules, StageStatus
from .clock import SystemClock
from .energy_meter import EnergyMeter, metered
from .entry import (
    PARTS,
    DeviceKeys,
    LaserKeys,
    Opening,
    Part,
    ReceiverKeys,
    entry_of,
    is_emulated,
)
from .exposure import exposure_line
from .folder_images import FolderImages
from .guided import GuidedStage, GuidedStageSettings, IgtlEncoder, Ros2Encoder, TypedStage
from .kdc101 import Kdc101Settings, Kdc101Stage
from .laserbox import LaserBox, LaserBoxSettings
from .picolas import PicolasLaser, PicolasSettings
from .plus import PlusReceiver, PlusSettings, connect_plus
from .poses import PoseReader, open_poses
from .ros2 import Ros2Stage, Ros2StageSettings
from .ros2_images import RosImages
from .serial_port import SerialPort
from .settings import BenchProbe, BenchSettings, BenchSupervisor, BenchTissue, bench_settings_from
from .simulated import SimulatedLaserSettings, SimulatedReceiverSettings, SimulatedStageSettings
from .sonixdaq import SonixDaqReceiver, SonixDaqSettings
from .standard_laser import LaserLogic, StandardLaser
from .standard_receiver import Messages, StandardReceiver
from .standard_stage import StandardStage
from .stereo_images import open_stereo_images
from .trace import trace_to, traced
from .vantage import VantageReceiver, VantageSettings, await_sender
from .video_images import VideoImages
from .ximc import XimcSettings, XimcStage

__all__ = [
    "PARTS",
    "BenchProbe",
    "BenchSettings",
    "BenchSupervisor",
    "BenchTissue",
    "DeviceKeys",
    "EnergyMeter",
    "FolderImages",
    "GuidedStage",
    "GuidedStageSettings",
    "IgtlEncoder",
    "Kdc101Settings",
    "Kdc101Stage",
    "LaserBox",
    "LaserBoxSettings",
    "LaserKeys",
    "LaserLogic",
    "Messages",
    "Opening",
    "Part",
    "PicolasLaser",
    "PicolasSettings",
    "PlusReceiver",
    "PlusSettings",
    "PoseReader",
    "ReceiverKeys",
    "Ros2Acquisition",
    "Ros2Encoder",
    "Ros2ReceiverSettings",
    "Ros2Stage",
    "Ros2StageSettings",
    "RosImages",
    "SerialPort",
    "SimulatedLaserSettings",
    "SimulatedReceiverSettings",
    "SimulatedStageSettings",
    "SonixDaqReceiver",
    "SonixDaqSettings",
    "StageLogic",
    "StageRules",
    "StageStatus",
    "StandardLaser",
    "StandardReceiver",
    "StandardStage",
    "SystemClock",
    "TypedStage",
    "VantageReceiver",
    "VantageSettings",
    "VideoImages",
    "XimcSettings",
    "XimcStage",
    "await_sender",
    "bench_settings_from",
    "connect_plus",
    "entry_of",
    "exposure_line",
    "is_emulated",
    "metered",
    "open_poses",
    "open_stereo_images",
    "trace_to",
    "traced",
]
