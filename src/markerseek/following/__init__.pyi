from .aim import Aim, HeldRegistration, ProbeReach, probe_reach
from .confirmation import Comparison, Confirmed, NotConfirmed, compare, confirm
from .endoscope_check import DarkPairs, EndoscopeCheck, GoingOn, NewestPairs
from .follower import Follower, FollowStep
from .machine import Decision, FollowMachine
from .plan import FollowPlan
from .pointed_place import PointedPlace, named_target
from .record import FollowBegun, FollowEnded, FollowLine, FollowRecord, follow_record
from .robot_tip import LARGEST_SIGMA_MM, FixedPoint, RobotTip
from .simulated import FollowedRoom, Motion, SimulatedSpot, SimulatedTip, TargetPath
from .spot_source import SpotSource
from .target import ErrorLinks, LitSource, Look, Target, TargetSource
from .validity import DevicesSeen, read_confirmed, write_confirmed
from .words import BY_A_PERSON, BY_ITSELF, Word

__all__ = [
    "BY_A_PERSON",
    "BY_ITSELF",
    "LARGEST_SIGMA_MM",
    "Aim",
    "Comparison",
    "Confirmed",
    "DarkPairs",
    "Decision",
    "DevicesSeen",
    "EndoscopeCheck",
    "ErrorLinks",
    "FixedPoint",
    "FollowBegun",
    "FollowEnded",
    "FollowLine",
    "FollowMachine",
    "FollowPlan",
    "FollowRecord",
    "FollowStep",
    "FollowedRoom",
    "Follower",
    "GoingOn",
    "HeldRegistration",
    "LitSource",
    "Look",
    "Motion",
    "NewestPairs",
    "NotConfirmed",
    "PointedPlace",
    "ProbeReach",
    "RobotTip",
    "SimulatedSpot",
    "SimulatedTip",
    "SpotSource",
    "Target",
    "TargetPath",
    "TargetSource",
    "Word",
    "compare",
    "confirm",
    "follow_record",
    "named_target",
    "probe_reach",
    "read_confirmed",
    "write_confirmed",
]
