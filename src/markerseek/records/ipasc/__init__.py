"""Banks in IPASC HDF5: written one acquisition at a time, read one frame at a time."""

from markerseek.records.ipasc.reading import IpascBank, read_ipasc
from markerseek.records.ipasc.whole import whole_bank
from markerseek.records.ipasc.writer import BankWriter, require_new_bank

__all__ = ["BankWriter", "IpascBank", "read_ipasc", "require_new_bank", "whole_bank"]
