"""Banks, that is scans of many angles: IPASC HDF5, a folder of frames, arrays, a sequence of PLUS, or a CSV table.

`read_bank` reads a bank, `read_arrays` arrays that can be made one, `load_frame` and `open_ultrasonix` single frames.
A child process tries HDF5 first (`markerseek.records.child`).
"""

from markerseek.records.banks.arrays import read_arrays
from markerseek.records.banks.bank import (
    HDF5_SUFFIXES,
    MIN_ANGLES,
    Bank,
    BankFacts,
    FrameBank,
    IntensityBank,
    record_of,
    require_angles,
    unwrapped,
)
from markerseek.records.banks.frames import MAT_PROBE, load_frame
from markerseek.records.banks.ipasc import IpascBank, require_new_bank, whole_bank
from markerseek.records.banks.layout import angles_in
from markerseek.records.banks.reading import read_bank, require_whole
from markerseek.records.banks.sequence import is_sequence, read_sequence
from markerseek.records.banks.table import DEFAULT_FORMAT, TableFormat, write_bank
from markerseek.records.banks.ultrasonix import UltrasonixFile, open_ultrasonix

__all__ = [
    "DEFAULT_FORMAT",
    "HDF5_SUFFIXES",
    "MAT_PROBE",
    "MIN_ANGLES",
    "Bank",
    "BankFacts",
    "FrameBank",
    "IntensityBank",
    "IpascBank",
    "TableFormat",
    "UltrasonixFile",
    "angles_in",
    "is_sequence",
    "load_frame",
    "open_ultrasonix",
    "read_arrays",
    "read_bank",
    "read_sequence",
    "record_of",
    "require_angles",
    "require_new_bank",
    "require_whole",
    "unwrapped",
    "whole_bank",
    "write_bank",
]
