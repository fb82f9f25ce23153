"""Error of registrations with markers found by searches: `registrations` draws them, ``python -m`` prints the table."""

from markerseek.studies.registration.marker_errors import MarkerError, kept_errors, search_errors, write_errors
from markerseek.studies.registration.trials import SOURCES, Conditions, Trial, registrations

__all__ = [
    "SOURCES",
    "Conditions",
    "MarkerError",
    "Trial",
    "kept_errors",
    "registrations",
    "search_errors",
    "write_errors",
]
