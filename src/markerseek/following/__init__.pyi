from .aim import Aim, HeldRegistration, ProbeReach
from .confirmation import Comparison, Confirmed, NotConfirmed, compare, confirm
from .follower import Follower, FollowStep
from .machine import BY_A_PERSON, BY_ITSELF, Decision, FollowMachine, Word
from .plan import FollowPlan
from .target import LitSource, Look, Target, TargetSource

__all__ = [
    "BY_A_PERSON",
    "BY_ITSELF",
    "Aim",
    "Comparison",
    "Confirmed",
    "Decision",
    "FollowMachine",
    "FollowPlan",
    "FollowStep",
    "Follower",
    "HeldRegistration",
    "LitSource",
    "Look",
    "NotConfirmed",
    "ProbeReach",
    "Target",
    "TargetSource",
    "Word",
    "compare",
    "confirm",
]
