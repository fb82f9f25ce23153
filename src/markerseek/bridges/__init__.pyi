from .child import ChildRun, Outcome, Searches, SearchOptions
from .followed import FollowedSession, RegistrationSource, open_registration
from .request import OPTIONS, SearchRequest

__all__ = [
    "OPTIONS",
    "ChildRun",
    "FollowedSession",
    "Outcome",
    "RegistrationSource",
    "SearchOptions",
    "SearchRequest",
    "Searches",
    "open_registration",
]
