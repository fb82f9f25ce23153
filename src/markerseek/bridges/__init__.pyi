from .child import ChildRun, Outcome, Searches, SearchOptions
from .followed import FollowedSession, RegistrationSource, open_registration
from .request import OPTIONS, AskedSearch

__all__ = [
    "OPTIONS",
    "AskedSearch",
    "ChildRun",
    "FollowedSession",
    "Outcome",
    "RegistrationSource",
    "SearchOptions",
    "Searches",
    "open_registration",
]
