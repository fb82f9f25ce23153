"""A served page and a headless browser for the tests of the live page; their helpers are in `page_browser`."""

from __future__ import annotations

import json

import pytest


@pytest.fixture(scope="session")
def browser():
    from tests.page.page_browser import browsing

    with browsing() as found:
        yield found


@pytest.fixture(scope="session")
def page(tmp_path_factory):
    """One page for all tests that do not end it."""
    from tests.page.page_browser import served

    with served(tmp_path_factory.mktemp("data")) as found:
        yield found


@pytest.fixture
def fresh_page(tmp_path):
    """A page of its own, in which nothing has been searched yet."""
    from tests.page.page_browser import served

    with served(tmp_path) as found:
        yield found


@pytest.fixture
def command_result(shell):
    """What `markerseek search` gives for the same arguments."""
    return lambda *options: json.loads(shell("search", *options, "--no-journal", "--json")[1])


@pytest.fixture
def opened(browser, page):
    """A function that opens a tab; nothing may go wrong in any of them."""
    from tests.page.page_browser import open_tab

    tabs = []

    def open_one(path="/search", query="", *, of=page, **options):
        tabs.append(open_tab(browser, of, path, query, **options))
        return tabs[-1]

    yield open_one
    for each in tabs:
        each.tab.context.close()
    assert [problem for each in tabs for problem in each.problems] == []
