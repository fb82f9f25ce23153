"""`markerseek` that acknowledges each event: ``python -m tests.faults.kills.acknowledging DESCRIPTOR ...``."""

from __future__ import annotations

import sys

from markerseek.cli import main

from .processes import acknowledge_events

if __name__ == "__main__":
    acknowledge_events(int(sys.argv.pop(1)))
    main()
