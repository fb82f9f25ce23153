from .commands import CommandAnswer, Request
from .peer import IPAddress, plain_address
from .service import IgtlServer, SearchService
from .streams import StreamMessage, Streams

__all__ = [
    "CommandAnswer",
    "IPAddress",
    "IgtlServer",
    "Request",
    "SearchService",
    "StreamMessage",
    "Streams",
    "plain_address",
]
