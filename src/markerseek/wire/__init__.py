"""Protocols and file headers as bytes, for drivers, emulators and records. Pure: no file is opened here."""

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
