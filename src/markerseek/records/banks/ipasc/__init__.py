"""Banks in IPASC HDF5: written whole, read one frame at a time."""

from markerseek.records.banks.ipasc.reading import IpascBank
from markerseek.records.banks.ipasc.writer import BankWriter, require_new_bank, require_room, whole_bank

__all__ = ["BankWriter", "IpascBank", "require_new_bank", "require_room", "whole_bank"]
