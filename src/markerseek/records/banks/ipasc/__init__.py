"""Banks in IPASC HDF5: written whole, read one frame at a time."""

from markerseek.records.banks.ipasc.reading import IpascBank
from markerseek.records.banks.ipasc.writer import require_new_bank, require_room, whole_bank

__all__ = ["IpascBank", "require_new_bank", "require_room", "whole_bank"]
