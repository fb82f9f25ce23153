"""Encoding and decoding of device protocols and file headers. Pure: no port or file is opened here."""

from markerseek.wire.apt import COUNTS_PER_DEG
from markerseek.wire.apt_frames import CONTROLLER, HOST, TO_CONTROLLER, AptFramer, AptMessage
from markerseek.wire.port import Port

__all__ = [
    "CONTROLLER",
    "COUNTS_PER_DEG",
    "HOST",
    "TO_CONTROLLER",
    "AptFramer",
    "AptMessage",
    "Port",
]
