from .child import ChildRun, Searches, SearchOptions
from .follow_feed import FollowFeed, StepListener
from .followed import FollowedSession, RegistrationSource, open_registration
from .outcome import Outcome
from .request import OPTIONS, SearchRequest

__all__ = [
    "OPTIONS",
    "ChildRun",
    "FollowFeed",
    "FollowedSession",
    "Outcome",
    "RegistrationSource",
    "SearchOptions",
    "SearchRequest",
    "Searches",
    "StepListener",
    "open_registration",
]
