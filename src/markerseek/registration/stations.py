"""Markers as the endoscope sees them now: those from before it moved are carried along by the motion of the scene.

A *station* is a place where the endoscope stood while markers were taken; it has the name of the first of them. The
motion from one station to another displaces all markers that are carried by it alike, so that its errors are errors
that they share: no residual shows them as noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from markerseek.core import Float64
from markerseek.registration.choice import SeenMarker
from markerseek.registration.endoscope_motion import EndoscopeMotion, EndoscopeNotKnown, SeenEndoscope
from markerseek.registration.steps import TakenMarker


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CarriedMarkers:
    """Markers in the frame of the camera as it stands now."""

    seen: tuple[SeenMarker, ...]
    """Those whose place in it is known, in their order."""
    lost: tuple[str, ...]
    """Names of the others: the endoscope has moved since, or may have, and it is not known by how much."""


def carry(markers: Sequence[TakenMarker], *, now: SeenEndoscope | None = None) -> CarriedMarkers:
    """Return the markers in the frame of the camera at the last of them, or of what was seen since.

    ``now``: what the images after the last marker show of the endoscope; None: it stands where it stood.
    """
    stations = station_names(markers)
    motions = {
        marker.name: marker.endoscope
        for marker in markers
        if stations[marker.name] == marker.name and isinstance(marker.endoscope, EndoscopeMotion)
    }
    here = stations[markers[-1].name] if markers else _HERE
    if now is not None and now.state != "at rest":
        here = _HERE
        if isinstance(now, EndoscopeMotion):
            motions[here] = now
    elif isinstance(now, EndoscopeMotion):
        here = stations.get(now.since, now.since)
    carried = {marker.name: _carried(marker.seen, stations[marker.name], here, motions) for marker in markers}
    return CarriedMarkers(
        seen=_alike([each for each in carried.values() if each is not None]),
        lost=tuple(name for name, each in carried.items() if each is None),
    )


_HERE = "here"
"""Name of a station without a marker; those of markers are numbers."""


def station_names(markers: Sequence[TakenMarker]) -> dict[str, str]:
    """Return the station of each marker, by their names."""
    stations: dict[str, str] = {}
    for marker in markers:
        seen = marker.endoscope
        if seen is None:
            # Nobody looked: the endoscope is taken to stand where it stood.
            stations[marker.name] = next(reversed(stations.values()), marker.name)
        elif isinstance(seen, EndoscopeMotion) and seen.state == "at rest":
            stations[marker.name] = stations.get(seen.since, seen.since)
        else:
            stations[marker.name] = marker.name
    return stations


def stands_elsewhere(markers: Sequence[TakenMarker], now: SeenEndoscope | None) -> bool:
    """Return whether the endoscope has moved since the last marker, or may have; ``now``: as of `carry`."""
    if now is None or not markers:
        return False
    if isinstance(now, EndoscopeNotKnown) or now.state == "moved":
        return True
    stations = station_names(markers)
    # It may be back where it stood at an earlier marker.
    return stations.get(now.since) != stations[markers[-1].name]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Moving:
    """A marker on its way from station to station."""

    marker: SeenMarker
    by_motion_m: dict[str, Float64[np.ndarray, "3 6"]]
    """Its displacements by the errors of each motion, in their standard deviations, by the station after the motion."""


def _carried(marker: SeenMarker, station: str, here: str, motions: dict[str, EndoscopeMotion]) -> _Moving | None:
    """Carry a marker from its station to another one; None if no known motions connect them."""
    back = _way_to_first(station, motions)
    there = _way_to_first(here, motions)
    if back[-1] != there[-1]:
        return None
    shared = next(each for each in back if each in there)
    moving = _Moving(marker=marker, by_motion_m={})
    for each in back[: back.index(shared)]:
        moving = _moved_back(moving, each, motions[each])
    for each in reversed(there[: there.index(shared)]):
        moving = _moved(moving, each, motions[each])
    return moving


def _way_to_first(station: str, motions: dict[str, EndoscopeMotion]) -> list[str]:
    """Return the stations from one back to the first that known motions reach."""
    way = [station]
    while (motion := motions.get(way[-1])) is not None:
        way.append(motion.since)
    return way


def _moved(moving: _Moving, station: str, motion: EndoscopeMotion) -> _Moving:
    """Carry a marker over a motion."""
    marker = moving.marker
    transform = motion.transform
    camera_m = transform.apply(marker.camera_m)
    by_motion_m = {name: transform.rotation @ each for name, each in moving.by_motion_m.items()}
    by_motion_m[station] = motion.effect_m(camera_m)
    return _Moving(marker=_turned(marker, camera_m, transform.rotation), by_motion_m=by_motion_m)


def _moved_back(moving: _Moving, station: str, motion: EndoscopeMotion) -> _Moving:
    """Carry a marker over a motion, from after it to before it."""
    marker = moving.marker
    back = motion.transform.inverse()
    by_motion_m = {name: back.rotation @ each for name, each in moving.by_motion_m.items()}
    by_motion_m[station] = -back.rotation @ motion.effect_m(marker.camera_m)
    return _Moving(marker=_turned(marker, back.apply(marker.camera_m), back.rotation), by_motion_m=by_motion_m)


def _turned(
    marker: SeenMarker, camera_m: Float64[np.ndarray, " 3"], rotation: Float64[np.ndarray, "3 3"]
) -> SeenMarker:
    """Return a marker at another place of the camera's frame.

    Errors of the calibration are not turned: the motion was seen with the same cameras, whose errors displace it as
    they displace what is there now.
    """
    return replace(marker, camera_m=camera_m, camera_covariance_m2=rotation @ marker.camera_covariance_m2 @ rotation.T)


def _alike(carried: Sequence[_Moving]) -> tuple[SeenMarker, ...]:
    """Return the markers, each with columns for all motions by which one of them was carried."""
    names = list(dict.fromkeys(name for each in carried for name in each.by_motion_m))
    unmoved = np.zeros((3, 6))
    return tuple(
        replace(
            each.marker,
            camera_motion_m=np.concatenate(
                [np.zeros((3, 0)), *(each.by_motion_m.get(name, unmoved) for name in names)], axis=1
            ),
        )
        for each in carried
    )
