"""Files as all readers and writers of this package open them.

`open_input` is the one way to open a file that somebody names: its kind and size are checked before a byte is read.
`new_file`, `create_atomically` and `replace_file` are the one way to write one: it is whole when its name is there.
"""

from markerseek.files.inputs import MIB, open_input, read_input, require_input
from markerseek.files.serial_line import SERIAL_ERRORS, Parity, open_serial
from markerseek.files.settings import known_keys, read_toml, require_choice, require_key
from markerseek.files.whole import create_atomically, new_file, replace_file, require_new, sync_folder

__all__ = [
    "MIB",
    "SERIAL_ERRORS",
    "Parity",
    "create_atomically",
    "known_keys",
    "new_file",
    "open_input",
    "open_serial",
    "read_input",
    "read_toml",
    "replace_file",
    "require_choice",
    "require_input",
    "require_key",
    "require_new",
    "sync_folder",
]
