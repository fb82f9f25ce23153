"""The table of drivers: the names that the key ``driver`` of a rig file can have, and the file of each driver.

A driver of this package is one line here and one file. A name ``module:Class``, or that of an entry point, is a foreign
driver (`markerseek.drivers.foreign`).
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping

from markerseek.core import ConfigError
from markerseek.drivers._foreign_class import installed_drivers
from markerseek.drivers.entry import AnyEntry, DeviceSettings, Part

DRIVERS: dict[Part, dict[str, str]] = {
    "stage": {
        "kdc101": "kdc101:ENTRY",
        "ros2": "ros2_stage:ENTRY",
        "guided": "guided:ENTRY",
        "ximc": "ximc:ENTRY",
        "simulated": "simulated:STAGE_ENTRY",
    },
    "laser": {
        "laserbox": "laserbox:ENTRY",
        "picolas": "picolas:ENTRY",
        "ros2": "ros2_acquisition:LASER_ENTRY",
        "simulated": "simulated:LASER_ENTRY",
    },
    "receiver": {
        "sonixdaq": "sonixdaq:ENTRY",
        "plus": "plus:ENTRY",
        "vantage": "vantage:ENTRY",
        "ros2": "ros2_acquisition:RECEIVER_ENTRY",
        "simulated": "simulated:RECEIVER_ENTRY",
    },
}
"""File and name of each entry; the first of a part is the default."""

_FOREIGN: dict[Part, str] = {
    "stage": "foreign:STAGE_ENTRY",
    "laser": "foreign:LASER_ENTRY",
    "receiver": "foreign:RECEIVER_ENTRY",
}


def entry_named(part: Part, driver: object) -> AnyEntry:
    """Entry of a driver by its name; only its file is imported."""
    known = DRIVERS[part]
    if not isinstance(driver, str) or (driver not in known and ":" not in driver):
        installed = installed_drivers()
        if driver in installed:
            return _entry(_FOREIGN[part])
        raise ConfigError(
            f"{part}.driver is {driver!r}, it must be one of: {', '.join((*known, *installed))}, or a class of "
            'your own as "module:Class"'
        )
    return _entry(known.get(driver, _FOREIGN[part]))


def entry_of(part: Part, settings: DeviceSettings) -> AnyEntry:
    """Entry of the driver that has these settings."""
    return entry_named(part, settings.driver)


def default_driver(part: Part, table: Mapping[str, object]) -> object:
    """Name of the driver in a table of a rig file; the default if the table names none."""
    return table.get("driver", next(iter(DRIVERS[part])))


def _entry(place: str) -> AnyEntry:
    module, _, name = place.partition(":")
    entry: AnyEntry = getattr(importlib.import_module(f"markerseek.drivers.{module}"), name)
    return entry
