from .hdf5 import as_record_error
from .notes import note

__all__ = ["as_record_error", "note"]
