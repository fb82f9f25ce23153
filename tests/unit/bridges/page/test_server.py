"""The public address of the page."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from markerseek.bridges.page.server import Address

Shell = Callable[..., tuple[int, str, str]]


@pytest.mark.parametrize(
    ("url", "origin"),
    [
        ("http://localhost:9000", "http://localhost:9000"),
        ("http://127.0.0.1:80/", "http://127.0.0.1"),
        ("https://Name.example", "https://name.example"),
        ("https://name.example:443/", "https://name.example"),
        ("https://name.example:8443", "https://name.example:8443"),
    ],
)
def test_a_public_url_is_an_origin_as_browsers_send_it(url: str, origin: str) -> None:
    assert Address(public_url=url).public == origin


@pytest.mark.parametrize(
    "url",
    [
        "localhost:9000",
        "http://lab.example:9000",
        "http://localhost:9000/page?view=1",
        "ftp://localhost",
        "http://a@localhost",
        "",
    ],
)
def test_a_public_url_that_cannot_be_is_wrong_usage(url: str, shell: Shell) -> None:
    code, _, err = shell("page", "--public-url", url)
    assert (code, "name what stands in the browser" in err) == (2, True)
