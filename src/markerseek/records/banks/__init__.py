"""Banks, that is scans of many angles: IPASC HDF5, a folder of frames, arrays, a sequence of PLUS, or a CSV table.

`read_bank` reads a bank, `read_arrays` arrays that can be made one, `load_frame` and `open_ultrasonix` single frames.
`write_bank` writes a table, `whole_bank` IPASC, `write_sequence` a sequence for 3D Slicer and PLUS, `write_zea` a file
of zea. A child process tries HDF5 first (`markerseek.records.child`).
"""

from markerseek.records.banks.arrays import read_arrays
from markerseek.records.banks.bank import (
    HDF5_SUFFIXES,
    MIN_ANGLES,
    Bank,
    BankFacts,
    FrameBank,
    IntensityBank,
    Series,
    first_of,
    record_of,
    require_angles,
    series_of,
    unwrapped,
)
from markerseek.records.banks.frames import MAT_PROBE, load_frame, open_ultrasonix
from markerseek.records.banks.ipasc_writer import require_new_bank, require_room, whole_bank
from markerseek.records.banks.reading import read_bank, require_whole
from markerseek.records.banks.sequence import SEQUENCE_SUFFIXES, angles_of, is_sequence, open_sequence, read_sequence
from markerseek.records.banks.sequence_writer import image_to_probe, probe_to_probe_home, write_sequence
from markerseek.records.banks.table import write_bank
from markerseek.records.banks.table_format import DEFAULT_FORMAT, TableFormat, angles_in, deg_per_unit_of
from markerseek.records.banks.zea import write_zea

__all__ = [
    "DEFAULT_FORMAT",
    "HDF5_SUFFIXES",
    "MAT_PROBE",
    "MIN_ANGLES",
    "SEQUENCE_SUFFIXES",
    "Bank",
    "BankFacts",
    "FrameBank",
    "IntensityBank",
    "Series",
    "TableFormat",
    "angles_in",
    "angles_of",
    "deg_per_unit_of",
    "first_of",
    "image_to_probe",
    "is_sequence",
    "load_frame",
    "open_sequence",
    "open_ultrasonix",
    "probe_to_probe_home",
    "read_arrays",
    "read_bank",
    "read_sequence",
    "record_of",
    "require_angles",
    "require_new_bank",
    "require_room",
    "require_whole",
    "series_of",
    "unwrapped",
    "whole_bank",
    "write_bank",
    "write_sequence",
    "write_zea",
]
