"""Files, settings in TOML and serial ports: how the whole package opens, reads and writes them.

`open_input` opens a file that a user names, once its kind and size are checked; `read_text`, `read_json`, `read_toml`
and `csv_rows` read what is in it; `as_read_error` turns errors of reading into a sentence. `natural`
sorts names by their numbers, `angle_in` reads an angle from a name, and `unit_in` the unit of one. `new_file` and
`replace_file` write a file under a temporary name and rename it when it is complete; `create_atomically` is the step
that `new_file` adds checks to. `open_for_writing` and `overwrite` write a file in place. None of them writes through a
link. `own_module` imports Python of the user.
"""

from markerseek.files.angle_units import DEG_PER, DEGREES, AngleUnit, unit_in
from markerseek.files.atomic import (
    create_atomically,
    new_file,
    open_for_writing,
    overwrite,
    replace_file,
    require_new,
    sync_folder,
)
from markerseek.files.csv_rows import DECIMAL_COMMA, CsvRows, csv_rows, is_number, may_be_number
from markerseek.files.inputs import (
    MIB,
    FileVersion,
    as_read_error,
    open_input,
    os_reason,
    quoted,
    read_input,
    read_json,
    read_text,
    require_input,
    version_of,
)
from markerseek.files.names import NamedAngle, angle_in, data_folder, endings, in_natural_order, natural, series_indices
from markerseek.files.own_code import is_class_name, own_lines, own_module
from markerseek.files.serial_line import SERIAL_ERRORS, Line, Parity, open_serial, pyserial
from markerseek.files.settings import (
    nearest_key,
    read_toml,
    recorded_settings,
    require_key,
    setting_from,
    settings_from,
)

__all__ = [
    "DECIMAL_COMMA",
    "DEGREES",
    "DEG_PER",
    "MIB",
    "SERIAL_ERRORS",
    "AngleUnit",
    "CsvRows",
    "FileVersion",
    "Line",
    "NamedAngle",
    "Parity",
    "angle_in",
    "as_read_error",
    "create_atomically",
    "csv_rows",
    "data_folder",
    "endings",
    "in_natural_order",
    "is_class_name",
    "is_number",
    "may_be_number",
    "natural",
    "nearest_key",
    "new_file",
    "open_for_writing",
    "open_input",
    "open_serial",
    "os_reason",
    "overwrite",
    "own_lines",
    "own_module",
    "pyserial",
    "quoted",
    "read_input",
    "read_json",
    "read_text",
    "read_toml",
    "recorded_settings",
    "replace_file",
    "require_input",
    "require_key",
    "require_new",
    "series_indices",
    "setting_from",
    "settings_from",
    "sync_folder",
    "unit_in",
    "version_of",
]
