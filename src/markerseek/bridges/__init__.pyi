from .asked import OPTIONS, AskedSearch
from .child import ChildRun, Outcome, Searches, SearchOptions
from .followed import FollowedSession, RegistrationSource, open_registration

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
