"""The commit that a table was made from."""

from __future__ import annotations

import subprocess
from pathlib import Path


def commit_made_from() -> str:
    """Commit of the working tree, and whether the package or the campaign was changed since."""
    here = Path(__file__).parent
    described = subprocess.run(["git", "rev-parse", "HEAD"], cwd=here, capture_output=True, text=True, check=False)
    root = here.parents[2]
    changed = subprocess.run(
        ["git", "status", "--porcelain", "src", "tests/faults/campaign"],
        cwd=root, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return described.stdout.strip()[:12] + (" with changes" if changed.stdout.strip() else "")
