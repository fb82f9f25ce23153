"""`markerseek` that tells those outside of each event: ``python -m tests.faults.kills.telling DESCRIPTOR ...``."""

from __future__ import annotations

import sys

from markerseek.cli import main

from .processes import telling_events

if __name__ == "__main__":
    telling_events(int(sys.argv.pop(1)))
    main()
