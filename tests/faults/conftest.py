"""Fixtures of the supervisor's tests: the far ends of its two lines."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.faults.pseudo_terminals import Device


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
