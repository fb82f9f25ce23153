"""Banks, that is scans of many angles: IPASC HDF5, a folder of frames, arrays, a sequence of PLUS, or a CSV table.

`read_bank` reads a bank, `read_arrays` arrays that can be made one, `load_frame` and `open_ultrasonix` single frames.
`write_bank` writes a table, `whole_bank` IPASC, `write_sequence` a sequence for 3D Slicer and PLUS, `write_zea` a file
of zea. A child process tries HDF5 first (`markerseek.records.child`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
