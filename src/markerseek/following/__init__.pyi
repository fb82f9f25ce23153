from .aim import Aim, HeldRegistration, ProbeReach, probe_reach
from .confirmation import Comparison, Confirmed, NotConfirmed, compare, confirm
from .endoscope_check import DarkPairs, EndoscopeCheck, NewestPairs
from .follower import Follower, FollowStep
from .machine import Decision, FollowMachine
from .plan import FollowPlan
from .robot_tip import FixedPoint, RobotTip
from .simulated import FollowedRoom, Motion, SimulatedSpot, SimulatedTip, TargetPath
from .spot_source import SpotSource
from .target import LitSource, Look, Target, TargetSource
from .words import BY_A_PERSON, BY_ITSELF, Word

__all__ = [
    "BY_A_PERSON",
    "BY_ITSELF",
    "Aim",
    "Comparison",
    "Confirmed",
    "DarkPairs",
    "Decision",
    "EndoscopeCheck",
    "FixedPoint",
    "FollowMachine",
    "FollowPlan",
    "FollowStep",
    "FollowedRoom",
    "Follower",
    "HeldRegistration",
    "LitSource",
    "Look",
    "Motion",
    "NewestPairs",
    "NotConfirmed",
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
    "probe_reach",
]
