"""How a journal is opened by SQLite, and its errors as ours.

The write-ahead log and ``synchronous = FULL`` make a commit survive the death of the process and of the machine. The
file is locked for whoever has it open to be written, so that two programs cannot drive one run.
"""

from __future__ import annotations

import errno
import os
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from markerseek.core import RecordError

WRITTEN = "mode=rw"
"""How a journal is opened to be written."""

UNUSED = "mode=ro"
"""How it is asked for whether another program has it open."""

FOLDED = "mode=ro&immutable=1"
"""How one is read whose log is not there or holds nothing; nothing is locked and nothing written."""

WITH_LOG = f"mode=ro&vfs={'win32' if sys.platform == 'win32' else 'unix'}-none"
"""How one is read together with its log. SQLite indexes a log in shared memory, a file that it would have to write, or,
where nobody else reads along, in its own: so nothing is locked here, and what is read stays as it is."""


def connect(path: Path, *, how: str) -> sqlite3.Connection:
    """Connection that commits only when told to, and locks the file while it is open to be written.

    Parameters
    ----------
    path
        An existing file.
    how
        One of the four above.

    Raises
    ------
    sqlite3.Error
        If it is locked or no database.
    """
    connection = sqlite3.connect(
        f"file:{_quoted(path)}?{how}", uri=True, isolation_level=None, timeout=0.5, check_same_thread=True
    )
    try:
        connection.execute("PRAGMA trusted_schema = OFF")
        connection.execute("PRAGMA cell_size_check = ON")
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")
        connection.execute("PRAGMA synchronous = FULL")
        # macOS calls a flush done before the disk has it, unless it is told so; the others do not know these two.
        connection.execute("PRAGMA fullfsync = ON")
        connection.execute("PRAGMA checkpoint_fullfsync = ON")
        # No commit waits until the log has been folded into the file: `Journal.close` does so.
        connection.execute("PRAGMA wal_autocheckpoint = 0")
    except BaseException:
        connection.close()
        raise
    return connection


def _quoted(path: Path) -> str:
    from urllib.parse import quote

    return quote(os.fsencode(path.absolute()))


@contextmanager
def speaking_of(path: Path, *, verb: str) -> Iterator[None]:
    """Turn SQLite's errors into a `RecordError` that names the file and the cure.

    Parameters
    ----------
    path
        The journal.
    verb
        What could not be done: "read", "written" or "closed".
    """
    try:
        yield
    except sqlite3.Error as problem:
        raise RecordError(f"{path}: the journal cannot be {verb}: {problem}; {_cure(problem)}") from problem
    except (OverflowError, MemoryError, UnicodeDecodeError) as problem:
        raise RecordError(f"{path}: the journal cannot be {verb}: it is damaged ({problem})") from problem
    except OSError as problem:
        said = problem.strerror or problem
        raise RecordError(f"{path}: the journal cannot be {verb}: {said}; {_way_out(problem, path)}") from problem


def _way_out(problem: OSError, path: Path) -> str:
    match problem.errno:
        case errno.ENOENT:
            return f"there is no folder {path.parent}; make it, or name another place"
        case errno.ENOTDIR:
            return f"{path.parent} is no folder; name another place"
        case errno.ENOSPC | errno.EDQUOT | errno.EIO:
            return "make room on the disk or name another place; what was committed before stays readable"
        case errno.ENAMETOOLONG:
            return "name it shorter"
        case _:
            return "check the folder and the rights, or name another place"


def _cure(problem: sqlite3.Error) -> str:
    match getattr(problem, "sqlite_errorname", "").split("_")[1:2]:
        case ["BUSY"] | ["LOCKED"]:
            return "another markerseek has it open; wait until that is over"
        case ["FULL"] | ["IOERR"]:
            return "make room on the disk or name another place; what was committed before stays readable"
        case ["READONLY"] | ["CANTOPEN"] | ["PERM"]:
            return "check the folder and the rights, or name another place"
        case ["NOTADB"]:
            return (
                "it does not begin as a journal does, so that it is another kind of file, or damaged; check the name "
                "('markerseek replay' searches recorded scans)"
            )
        case _:
            return "it is damaged or no journal; 'markerseek journal show' prints as much of it as is whole"
