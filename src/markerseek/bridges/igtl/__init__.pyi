from .commands import Answer, Request
from .server import PORT, IgtlServer
from .service import SearchService
from .streams import Stream, Streams

__all__ = [
    "PORT",
    "Answer",
    "IgtlServer",
    "Request",
    "SearchService",
    "Stream",
    "Streams",
]
