from .commands import CommandAnswer, Request
from .server import PORT, IgtlServer
from .service import SearchService
from .streams import Stream, Streams

__all__ = [
    "PORT",
    "CommandAnswer",
    "IgtlServer",
    "Request",
    "SearchService",
    "Stream",
    "Streams",
]
