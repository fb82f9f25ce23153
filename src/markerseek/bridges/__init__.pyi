from .asked import OPTIONS, AskedSearch
from .child import ChildRun, Outcome
from .followed import FollowedSession, RegistrationSource, open_registration
from .recordings import Recording, open_recording
from .searches import Searches, SearchOptions

__all__ = [
    "OPTIONS",
    "AskedSearch",
    "ChildRun",
    "FollowedSession",
    "Outcome",
    "Recording",
    "RegistrationSource",
    "SearchOptions",
    "Searches",
    "open_recording",
    "open_registration",
]
