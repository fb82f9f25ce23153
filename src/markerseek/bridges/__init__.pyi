from .child import ChildRun, Outcome
from .recording import PlayedSample, Recording
from .searches import Searches, SearchOptions, SearchRequest

__all__ = ["ChildRun", "Outcome", "PlayedSample", "Recording", "SearchOptions", "SearchRequest", "Searches"]
