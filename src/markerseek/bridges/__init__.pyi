from .child import ChildRun, Outcome
from .recordings import Recording, open_recording
from .searches import Searches, SearchOptions, SearchRequest

__all__ = ["ChildRun", "Outcome", "Recording", "SearchOptions", "SearchRequest", "Searches", "open_recording"]
