"""Fixtures of the supervisor's tests: the far ends of its two lines."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from pseudo_terminals import Device


@pytest.fixture
def laser() -> Iterator[Device]:
    device = Device()
    yield device
    device.close()


@pytest.fixture
def stage() -> Iterator[Device]:
    device = Device()
    yield device
    device.close()
