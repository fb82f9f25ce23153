"""A short version of the campaign of `kill_campaign.py`: nothing is lost, every search is resumed to its result."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

CAMPAIGN = Path(__file__).with_name("kill_campaign.py")


def test_searches_that_are_killed_lose_nothing_and_resume_to_the_same_result() -> None:
    done = subprocess.run(
        [sys.executable, str(CAMPAIGN), "--kills", "30", "--seed", "5"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    figures = {name.strip(): int(number) for name, number in re.findall(r"^(.+?)\s+(\d+)$", done.stdout, re.M)}
    assert figures["all"] >= 30
    assert min(figures[kind] for kind in ("step", "resume", "write")) >= 1
    begun = figures["searches killed after that, once or twice"]
    assert begun >= 20
    assert figures["of them resumed and equal to the whole search"] == begun
    assert figures["events acknowledged before a death"] > 100
