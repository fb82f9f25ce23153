"""OpenIGTLink messages as bytes: header, CRC, metadata (header version 2) and contents, packed and checked.

TRANSFORM, IMAGE and POINT are packed and unpacked by pyigtl. The rest is here: pyigtl checks no CRC and no length, cuts
names off in silence, cannot send a text that is not ASCII, has 152 bytes for a POSITION where the standard has 28, and
has no STATUS and no COMMAND. All numbers are big-endian (http://openigtlink.org/developers/spec).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
