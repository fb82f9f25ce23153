"""Point pairs for a registration: a CSV of coordinates, markers of searches, spots in camera pixels and images."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from markerseek.core import ConfigError, Float64, RecordError, UInt8
from markerseek.files import DECIMAL_COMMA, MIB, as_read_error, csv_rows, endings, in_natural_order, natural, read_input
from markerseek.geometry import Camera
from markerseek.registration.report import PointPair, register_pairs
from markerseek.registration.shared_errors import seen_point
from markerseek.registration.stereo_files import StereoSettings
from markerseek.runs import read_marker
from markerseek.vision import LaserSpot, decoded_image, find_spot

_COLUMNS: dict[str, tuple[str, ...]] = {
    "trus_m": ("trus_x_m", "trus_y_m", "trus_z_m"),
    "camera_m": ("camera_x_m", "camera_y_m", "camera_z_m"),
    "pixels": ("left_x_px", "left_y_px", "right_x_px", "right_y_px"),
    "trus_sigma_m": ("trus_sigma_x_m", "trus_sigma_y_m", "trus_sigma_z_m"),
    "camera_sigma_m": ("camera_sigma_x_m", "camera_sigma_y_m", "camera_sigma_z_m"),
    "spot_sigma_px": ("spot_sigma_px",),
}
"""Columns of a table of points by what they hold: all of a kind or none."""

_LARGEST_BYTES = 8 * MIB

_MAX_MAGNITUDE = 1e6
"""Largest magnitude of a number in the table, in metres or pixels."""

_Row = tuple[str, dict[str, tuple[float, ...]]]
"""Name of a point, and its numbers by what they are, as in `_COLUMNS`."""


def point_pairs(
    points: Path, *, searches: Sequence[Path] = (), stereo: StereoSettings | None = None
) -> list[PointPair]:
    """Return the point pairs of a CSV; searches may take the place of its TRUS columns, and pixels of the others.

    ``points``: the CSV, with the columns of `_COLUMNS` and ``name``; others are ignored, unless their name contains
    sigma. ``searches``: journals or results, one for each row; none: the CSV has these columns. ``stereo``:
    calibration with which its pixels are triangulated; None: it has the columns of camera points.
    """
    kinds, rows = _table(points)
    if searches and len(searches) != len(rows):
        raise ConfigError(
            f"{len(searches)} searches and {len(rows)} rows of {points}; give `searches` once for each row, in order"
        )
    _require_columns(points, kinds, searched=bool(searches), stereo=stereo is not None)
    found: Sequence[Path | None] = searches or [None] * len(rows)
    pairs = [_pair(name, numbers, search, stereo) for (name, numbers), search in zip(rows, found, strict=True)]
    if stereo is not None:
        _require_full_size(points, rows, pairs, stereo)
    return pairs


_REDUCED = (2.0, 4.0, 1.5, 3.0)
"""How many times smaller than the sensor's images are shown or saved, the usual ones first."""


def _require_full_size(points: Path, rows: Sequence[_Row], pairs: Sequence[PointPair], stereo: StereoSettings) -> None:
    """Refuse pixels that do not fit, and would if they counted in smaller images than those of the calibration."""
    try:
        if register_pairs(pairs).registered:
            return
    except ConfigError:
        return
    for factor in _REDUCED:
        with suppress(ConfigError):
            larger = [
                _enlarged(pair, name, numbers, stereo, factor)
                for pair, (name, numbers) in zip(pairs, rows, strict=True)
            ]
            if register_pairs(larger).registered:
                width, height = (round(each / factor) for each in stereo.left.size_px)
                raise RecordError(
                    f"{points}: the points do not fit, but would if its pixels were of images of {width} x {height}, "
                    f"{factor:g} times smaller than the {stereo.left.size_px[0]} x {stereo.left.size_px[1]} of the "
                    "calibration; measure them in images as the cameras give them, or multiply them by "
                    f"{factor:g}"
                )


def _enlarged(
    pair: PointPair, name: str, numbers: dict[str, tuple[float, ...]], stereo: StereoSettings, factor: float
) -> PointPair:
    """Return the pair with its pixels in an image that is larger by a factor."""
    # The centre of a pixel has whole coordinates.
    scaled = {"pixels": tuple((each + 0.5) * factor - 0.5 for each in numbers["pixels"])}
    if "spot_sigma_px" in numbers:
        scaled["spot_sigma_px"] = tuple(factor * each for each in numbers["spot_sigma_px"])
    camera_m, covariance_m2, shared_m = _camera_point(name, scaled, stereo)
    return replace(pair, camera_m=camera_m, camera_covariance_m2=covariance_m2, camera_shared_m=shared_m)


DARK = "dark"
"""Folder in that of a spot, with images of the same scene with the laser off."""


def spot_pairs(left: Path, right: Path, *, searches: Sequence[Path], stereo: StereoSettings) -> list[PointPair]:
    """Return the point pairs of searches and of the images of both cameras.

    ``left``, ``right``: folders with one of each marker, which holds the camera's images of its spot, and in `DARK`
    those with the laser off. ``searches``: their journals or results, each with the name of the marker. ``stereo``:
    calibration of the cameras. Raises `RecordError` if images show no spot that can be measured.
    """
    for folder in (left, right):
        if not folder.is_dir():
            raise ConfigError(f"`frames`: {folder} is no folder; name that of the left and that of the right camera")
    names = [[each.name for each in in_natural_order(side.iterdir()) if each.is_dir()] for side in (left, right)]
    journals = sorted((path.stem for path in searches), key=natural)
    if not names[0] == names[1] == journals:
        raise ConfigError(
            f"markers: {left} holds {', '.join(names[0]) or 'none'}; {right} {', '.join(names[1]) or 'none'}; "
            f"`searches` names {', '.join(journals) or 'none'}; give each marker a folder "
            "on both sides, and a journal of its name"
        )
    pairs = []
    for path in sorted(searches, key=lambda each: natural(each.stem)):
        spots = [_spot(folder / path.stem, camera) for folder, camera in ((left, stereo.left), (right, stereo.right))]
        pixels = tuple(number for spot, _ in spots for number in spot)
        numbers = {"pixels": pixels, "spot_sigma_px": (max(sigma_px for _, sigma_px in spots),)}
        pairs.append(_pair(path.stem, numbers, path, stereo))
    return pairs


_MAX_IMAGES = 2000
"""Most images of one camera at one point; 25 are usual."""


def read_camera_images(folder: Path) -> list[UInt8[np.ndarray, "rows columns"]]:
    """Return the images of a camera from the PNG files of a folder, in natural order: the brightest of the colours."""
    held = in_natural_order(folder.iterdir()) if folder.is_dir() else []
    files = [each for each in held if each.suffix.lower() == ".png" and not each.name.startswith(".")]
    if not 0 < len(files) <= _MAX_IMAGES:
        raise RecordError(
            f"{folder}: {len(files)} PNG files, 1 to {_MAX_IMAGES} are read, and it holds {endings(held)}; save the "
            "camera's frames as PNG"
        )
    found = []
    for file in files:
        with as_read_error(file):
            data = read_input(file, most_bytes=64 * MIB)
        try:
            image = decoded_image(data)
        except ConfigError as problem:
            raise RecordError(f"{file}: {problem}") from problem
        if image is None:
            raise RecordError(f"{file}: it cannot be read as an image: it is cut off, or no PNG; export it again")
        found.append(image)
    return found


def _spot(folder: Path, camera: Camera) -> tuple[tuple[float, float], float]:
    """Return the pixel of the spot in the images of a folder, and its standard deviation in pixels."""
    frames = read_camera_images(folder)
    dark = read_camera_images(folder / DARK) if (folder / DARK).is_dir() else []
    if misfit := camera.size_problem(frames[0]):
        raise RecordError(f"{folder}: {misfit}")
    try:
        spot = find_spot(frames, dark=dark)
    except ConfigError as problem:
        raise RecordError(f"{folder}: {problem}") from problem
    if not isinstance(spot, LaserSpot):
        raise RecordError(f"{folder}: {spot.reason}")
    if spot.sigma_px is None:
        raise RecordError(
            f"{folder}: {len(frames)} images do not show how certain the spot is; save at least 3 of each"
        )
    return (spot.x_px, spot.y_px), spot.sigma_px


def _require_columns(points: Path, kinds: Collection[str], *, searched: bool, stereo: bool) -> None:
    """Refuse a table whose columns do not go with the options."""
    if searched and "trus_m" in kinds:
        raise ConfigError(f"{points}: it has the columns trus_x_m …, and `searches` gives the same; leave one out")
    if not searched and "trus_m" not in kinds:
        raise ConfigError(
            f"{points}: the columns trus_x_m, trus_y_m, trus_z_m are missing; add them, or name the searches by "
            "`searches`"
        )
    if stereo and "pixels" not in kinds:
        raise ConfigError(f"{points}: `stereo` needs the columns left_x_px, left_y_px, right_x_px, right_y_px")
    if stereo and "camera_m" in kinds:
        raise ConfigError(f"{points}: it has camera points and pixels; leave the columns of one out")
    if not stereo and "camera_m" not in kinds:
        if "pixels" in kinds:
            raise ConfigError(f"{points}: it has pixels; name the calibration of the endoscope by `stereo=FILE`")
        raise ConfigError(f"{points}: the columns camera_x_m, camera_y_m, camera_z_m are missing, or left_x_px …")


def _pair(
    name: str, numbers: dict[str, tuple[float, ...]], search: Path | None, stereo: StereoSettings | None
) -> PointPair:
    """Return a point pair; its point in the TRUS frame is that of a search, or None: from the columns."""
    camera_m, camera_covariance_m2, shared_m = _camera_point(name, numbers, stereo)
    marker = None if search is None else read_marker(search)
    return PointPair(
        name=name,
        trus_m=np.array(numbers["trus_m"] if marker is None else marker.position_m),
        camera_m=camera_m,
        trus_covariance_m2=_covariance(numbers.get("trus_sigma_m")) if marker is None else marker.covariance_m2,
        camera_covariance_m2=camera_covariance_m2,
        camera_shared_m=shared_m,
    )


def _camera_point(
    name: str, numbers: dict[str, tuple[float, ...]], stereo: StereoSettings | None
) -> tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"] | None, Float64[np.ndarray, "3 errors"] | None]:
    """Return the camera point of a row with its covariance and shared errors, stated or triangulated."""
    if stereo is None:
        return np.array(numbers["camera_m"]), _covariance(numbers.get("camera_sigma_m")), None
    (spot_px,) = numbers.get("spot_sigma_px", (0.0,))
    left, right = np.split(np.array(numbers["pixels"]), 2)
    try:
        return seen_point(left, right, stereo.cameras, spot_px=spot_px, calibration_px=stereo.calibration_sigma_px)
    except ConfigError as problem:
        raise ConfigError(f"row {name}: {problem}") from problem


def _covariance(sigmas_m: Sequence[float] | None) -> Float64[np.ndarray, "3 3"] | None:
    return None if sigmas_m is None else np.diag(np.square(sigmas_m))


def _table(path: Path) -> tuple[Collection[str], list[_Row]]:
    """Return what the columns of a CSV hold, and its rows."""
    table = csv_rows(
        path,
        most_bytes=_LARGEST_BYTES,
        what="a CSV of points",
        cure=f"its first line names the columns {', '.join(_COLUMNS['trus_m'] + _COLUMNS['camera_m'])}",
    )
    heading = table.names
    doubled = next((name for name in heading if heading.count(name) > 1), None)
    if doubled is not None:
        raise RecordError(f"{path}, line 1: the column {doubled} appears more than once; keep one of them")
    _require_known_sigmas(path, heading)
    present = {kind: names for kind, names in _COLUMNS.items() if _present(path, heading, names)}
    rows: list[_Row] = []
    indices = [heading.index(name) for names in present.values() for name in names]
    texts = table.numbers(path, indices)
    for line, cells in table.cells.items():
        where = f"{path}, line {line}"
        # A decimal comma in a table that commas separate shifts all columns behind it.
        if any(cell.strip() for cell in cells[table.width :]):
            raise RecordError(f"{where}: it has {len(cells)} columns, {table.width} are named; {DECIMAL_COMMA}")
        row = dict(zip(heading, cells, strict=False))
        given = iter(texts[line])
        numbers = {
            kind: tuple(_number(where, name, next(given), positive="sigma" in kind) for name in names)
            for kind, names in present.items()
        }
        name = row.get("name", "").strip() or str(len(rows) + 1)
        if name in (other for other, _ in rows):
            raise RecordError(f"{where}: there are two points named {name}; give each a name of its own")
        rows.append((name, numbers))
    return present.keys(), rows


def _require_known_sigmas(path: Path, heading: Sequence[str]) -> None:
    """Refuse a misspelt standard deviation: else all points would count alike, without a warning."""
    known = [name for names in _COLUMNS.values() for name in names if "sigma" in name]
    unknown = next((name for name in heading if "sigma" in name.casefold() and name not in known), None)
    if unknown is not None:
        raise RecordError(
            f"{path}, line 1: the column {unknown} is unknown; name a standard deviation {', '.join(known[:-1])} or "
            f"{known[-1]}, or leave it out"
        )


def _present(path: Path, heading: Sequence[str], names: Sequence[str]) -> bool:
    """Return whether the columns are there: all or none."""
    missing = [name for name in names if name not in heading]
    if missing and len(missing) < len(names):
        those = f"column {missing[0]} is" if len(missing) == 1 else f"columns {' and '.join(missing)} are"
        raise RecordError(f"{path}, line 1: the {those} missing beside the others of the same kind")
    return not missing


def _number(where: str, name: str, text: str, *, positive: bool) -> float:
    try:
        value = float(text)
    except ValueError:
        raise RecordError(f"{where}: {name} is {text!r}, it must be a number") from None
    if not math.isfinite(value):
        raise RecordError(f"{where}: {name} is {value}, it must be finite; leave that point out")
    # Squares of larger numbers overflow; millimetres for metres are refused later, with their own sentence.
    if not abs(value) <= _MAX_MAGNITUDE:
        raise RecordError(f"{where}: {name} is {value}, it must lie within ± {_MAX_MAGNITUDE:g}; check the unit")
    if positive and not value > 0:
        raise RecordError(f"{where}: {name} is {value}, a standard deviation must be above 0")
    return value
