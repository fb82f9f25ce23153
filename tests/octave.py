"""Whether GNU Octave can open a connection on this computer."""

from __future__ import annotations

import shutil
import subprocess
from functools import cache

NO_OCTAVE = "GNU Octave with sockets is missing (apt-get install octave octave-sockets)"


@cache
def has_octave_sockets() -> bool:
    if shutil.which("octave-cli") is None:
        return False
    loaded = ["octave-cli", "--no-init-file", "--eval", "pkg load sockets"]
    return subprocess.run(loaded, capture_output=True, check=False).returncode == 0
