"""The slider over the events of a run: which one is shown while the run goes on."""

import pytest

pytest.importorskip("nicegui", reason="NiceGUI is not installed")

from nicegui import Client, ui

from markerseek.bridges.page.timeline import Timeline


class GrowingRun:
    """A run whose thread adds an event whenever somebody looks how many there are."""

    def __init__(self):
        self._count = 1

    @property
    def snapshots(self):
        self._count += 1
        return list(range(self._count))


@pytest.fixture
def timeline():
    with Client(ui.page("/timeline")):
        yield Timeline()


def test_a_run_that_goes_on_is_followed(timeline):
    run = GrowingRun()
    shown = [timeline.snapshot(run) for _ in range(5)]
    assert shown == sorted(shown)
    assert timeline._following


def test_what_a_person_chooses_is_kept(timeline):
    run = GrowingRun()
    for _ in range(5):
        timeline.snapshot(run)
    timeline._slider.set_value(2)
    assert [timeline.snapshot(run) for _ in range(3)] == [2, 2, 2]
    timeline.clear()
    assert timeline.snapshot(run) > 2
