"""Files, settings in TOML and serial ports: how the whole package opens, reads and writes them.

`open_input` opens a file that a user names, once its kind and size are checked; `as_read_error` turns errors of reading
into a sentence. `new_file` and `replace_file` write a file under a temporary name and rename it when it is
complete; `create_atomically` is the step that `new_file` adds checks to.
"""

from markerseek.files.atomic import create_atomically, new_file, replace_file, require_new, sync_folder
from markerseek.files.csv_rows import CsvRows, csv_rows
from markerseek.files.inputs import MIB, as_read_error, open_input, read_input, require_input
from markerseek.files.serial_line import SERIAL_ERRORS, Parity, open_serial
from markerseek.files.settings import convert_settings, in_words, known_keys, read_toml, require_choice, require_key

__all__ = [
    "MIB",
    "SERIAL_ERRORS",
    "CsvRows",
    "Parity",
    "as_read_error",
    "convert_settings",
    "create_atomically",
    "csv_rows",
    "in_words",
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
