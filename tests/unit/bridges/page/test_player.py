"""The slider over the events of a run: which one is shown while the run goes on."""

import pytest

pytest.importorskip("nicegui", reason="NiceGUI is not installed")

from nicegui import Client, ui

from markerseek.bridges.page.panels import RunPlayer, VerdictPanel
from markerseek.core import PAPER_RANGE


class GrowingRun:
    """A run whose thread adds an event whenever somebody looks how many there are."""

    def __init__(self):
        self._count = 1

    @property
    def views(self):
        self._count += 1
        return list(range(self._count))


@pytest.fixture
def player():
    with Client(ui.page("/player")):
        yield RunPlayer(PAPER_RANGE, VerdictPanel())


def test_a_run_that_goes_on_is_followed(player):
    run = GrowingRun()
    shown = [player.view(run) for _ in range(5)]
    assert shown == sorted(shown)
    assert player._following


def test_what_a_person_chooses_is_kept(player):
    run = GrowingRun()
    for _ in range(5):
        player.view(run)
    player._slider.set_value(2)
    assert [player.view(run) for _ in range(3)] == [2, 2, 2]
    player.clear()
    assert player.view(run) > 2
