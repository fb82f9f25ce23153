from .commands import CommandAnswer, Request
from .follow_service import FollowService
from .peer import IPAddress, plain_address
from .service import IgtlServer, SearchService
from .streams import StreamMessage, Streams

__all__ = [
    "CommandAnswer",
    "FollowService",
    "IPAddress",
    "IgtlServer",
    "Request",
    "SearchService",
    "StreamMessage",
    "Streams",
    "plain_address",
]
