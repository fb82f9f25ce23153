from .asked import OPTIONS, AskedSearch
from .child import ChildRun, Outcome
from .followed import FollowedSession, RegistrationSource, open_registration
from .searches import Searches, SearchOptions

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
