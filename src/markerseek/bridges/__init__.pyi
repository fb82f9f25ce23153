from .child import ChildRun, Outcome
from .searches import Searches, SearchOptions, SearchRequest

__all__ = ["ChildRun", "Outcome", "SearchOptions", "SearchRequest", "Searches"]
