from .arrays import read_arrays
from .bank import (
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
from .frames import MAT_PROBE, load_frame, open_ultrasonix
from .ipasc_writer import require_new_bank, require_room, whole_bank
from .reading import read_bank, require_whole
from .sequence import SEQUENCE_SUFFIXES, angles_of, is_sequence, open_sequence, read_sequence
from .sequence_writer import image_to_probe, probe_to_probe_home, write_sequence
from .table import write_bank
from .table_angles import angles_in, deg_per_unit_of
from .table_format import ANGLE_FIELD, DEFAULT_FORMAT, TableFormat
from .zea import write_zea

__all__ = [
    "ANGLE_FIELD",
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
