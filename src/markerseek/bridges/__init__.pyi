from .asked import OPTIONS, AskedSearch
from .child import ChildRun, Outcome
from .recordings import Recording, open_recording
from .searches import Searches, SearchOptions

__all__ = ["OPTIONS", "AskedSearch", "ChildRun", "Outcome", "Recording", "SearchOptions", "Searches", "open_recording"]
