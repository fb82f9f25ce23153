"""``python -m markerseek`` is the command ``markerseek``."""

from markerseek.cli import main

main()
