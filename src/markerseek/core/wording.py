"""Messages for people: those of the packages name an argument or a function in backquotes, as Python has it.

```first_frame=3```, ```read_bank(scan.hdf5)```. Whoever shows a message to a person who writes no Python names them in
other words: the command line by its options and commands, the page by its labels, other programs plainly.
"""

from __future__ import annotations

import re
from collections.abc import Callable

_CALL = re.compile(r"`([a-z_]+)\(([^`]*)\)`")
_ARGUMENT = re.compile(r"`([a-z][a-z0-9_]*)(?:=([^`]*))?`")


def reworded(message: str, *, call: Callable[[str, str], str], argument: Callable[[str, str | None], str]) -> str:
    """Return a message in which functions and arguments are named in other words.

    ``call``: makes them of the name of a function and its arguments as text; ``argument``: of the name of an argument
    and its value as text, None if only the name stands there.
    """
    message = _CALL.sub(lambda found: call(found[1], found[2]), message)
    return _ARGUMENT.sub(lambda found: argument(found[1], found[2]), message)


def plain(message: str, *, label: Callable[[str], str] = lambda name: name.replace("_", " ")) -> str:
    """Return a message without backquotes; ``label``: what an argument is called."""
    return reworded(
        message,
        call=lambda function, arguments: f"{function}({arguments})",
        argument=lambda name, value: label(name) if value is None else f"{label(name)} {value}",
    )
