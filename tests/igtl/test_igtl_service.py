"""The service of OpenIGTLink before it is opened."""

from __future__ import annotations

import asyncio

from markerseek.bridges import SearchOptions
from markerseek.bridges.igtl import SearchService


def test_a_service_that_was_not_opened_can_be_closed() -> None:
    notes: list[str] = []
    service = SearchService(SearchOptions(), on_note=notes.append)
    asyncio.run(service.close())
    assert notes == []
