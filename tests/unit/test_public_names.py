"""The names at the top are few, and each is there."""

from __future__ import annotations

import markerseek


def test_the_public_names_are_these() -> None:
    assert sorted(markerseek.__all__) == [
        "Ambiguous",
        "AtBound",
        "Finished",
        "Found",
        "Interval",
        "MarkerseekError",
        "Measured",
        "NotFound",
        "Policy",
        "Reading",
        "Sample",
        "Unsure",
        "__version__",
        "build",
        "replayed",
        "run",
        "simulated",
    ]
    for name in markerseek.__all__:
        assert getattr(markerseek, name) is not None
