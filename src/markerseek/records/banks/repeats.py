"""Compares the passes of a scan, and averages repeated angles.

A scan there and back is two curves, one shifted from the other by the backlash of the stage, or by the delay of its
reading. Their mean is right for neither. Passes are found by the order of the acquisitions: one ends where the probe
turns back by more than half of the range. Where the order shows none, because a table was sorted by its angles, the
first acquisitions of all angles are compared with the second ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markerseek.core import Bool, Float64, Int64, counted
from markerseek.records.banks.bank import MIN_STEP_DEG, require_angles, unwrapped
from markerseek.records.notes import note

_FEWEST = 10
"""Fewest acquisitions of a pass that is compared."""

_LEAST_SHIFT_DEG = 0.1
"""Least shift that counts: averaging errs by half of it, which is a third of the least sigma of an answer."""

_LEAST_LIKENESS = 0.5
"""Least share of a pass's variance that another one explains: less is noise, which has no place."""

_LEAST_SIGMAS = 5.0
"""Least shift in standard deviations of its estimate."""

_DOUBTED_DEG = 0.3
"""Least shift that is named where it is not proven: averaging would err by the least sigma of an answer."""

_DOUBTED_SIGMAS = 3.0
"""Least shift that is named where it is not proven, in standard deviations."""

_MOST_SHIFT = 0.5
"""Largest shift that is tried, as a share of the range."""

_MOST_TRIED = 400

_LEAST_SHARE = 0.8
"""Least share of the acquisitions of the longest pass that the one which is used has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Merged:
    """Acquisitions of a scan, by their angles."""

    angles_deg: tuple[float, ...]
    """Angles in rising order, without repeats."""
    groups: tuple[Int64[np.ndarray, " n"], ...]
    """Numbers of the acquisitions at each angle, counted from 0; none of a pass that is left out."""

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the mean of the acquisitions at each angle, in the type of `values`, whole numbers rounded."""
        return np.stack([_mean(values[group]) for group in self.groups])

    def total(self, values: np.ndarray) -> np.ndarray:
        """Return the sum of the acquisitions at each angle."""
        return np.stack([values[group].sum(axis=0) for group in self.groups])


def _mean(values: np.ndarray) -> np.ndarray:
    if len(values) == 1:
        return np.asarray(values[0])
    mean = values.mean(axis=0, dtype=np.result_type(values, np.float64))
    return np.asarray(np.rint(mean) if values.dtype.kind in "iu" else mean, dtype=values.dtype)


def merged(
    path: Path,
    angles_deg: Float64[np.ndarray, " n"],
    intensities: Callable[[], Float64[np.ndarray, " n"]],
) -> Merged:
    """Return the acquisitions by their angles, in rising order, without the jump of a full turn.

    Passes that are shifted from the first long one are left out (`of_one_direction`). A warning says what is averaged
    or left out. Refused where a search cannot use the angles.

    ``angles_deg``: in the order of the acquisitions. ``intensities``: called where passes are to be compared.
    """
    turned_deg = unwrapped(path, angles_deg)
    steps_deg = np.diff(turned_deg)
    monotonic = bool((steps_deg >= MIN_STEP_DEG).all() or (steps_deg <= -MIN_STEP_DEG).all())
    compared = np.zeros(turned_deg.size) if monotonic else intensities()
    kept = np.arange(turned_deg.size) if monotonic else np.flatnonzero(of_one_direction(path, turned_deg, compared))
    order = kept[np.argsort(turned_deg[kept], kind="stable")]
    first = np.flatnonzero(np.diff(turned_deg[order], prepend=-np.inf) >= MIN_STEP_DEG)
    found = tuple(turned_deg[order][first].tolist())
    require_angles(path, found)
    groups = tuple(np.split(order, first[1:]))
    repeated = [group for group in groups if group.size > 1]
    if repeated:
        spread = [float(np.ptp(compared[group])) for group in groups]
        most = int(np.argmax(spread))
        note(
            path,
            f"{counted(len(repeated), 'repeated angle')}; the acquisitions of each are averaged; they differ by at "
            f"most {spread[most]:.3g}, at {found[most]:g} deg (the largest of all is {compared[order].max():.3g})",
        )
    return Merged(angles_deg=found, groups=groups)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pass:
    """Acquisitions in one direction."""

    name: str
    chosen: Bool[np.ndarray, " n"]


def of_one_direction(
    path: Path, angles_deg: Float64[np.ndarray, " n"], intensities: Float64[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Return which acquisitions are not shifted from the first long pass; a warning names those that are.

    ``angles_deg``: in the order of the acquisitions.
    """
    usable = np.isfinite(angles_deg) & np.isfinite(intensities)
    passes = _passes(np.where(usable, angles_deg, np.nan))
    kept = np.ones(angles_deg.size, dtype=bool)
    if len(passes) < 2:
        return kept
    counts = [int(each.chosen.sum()) for each in passes]
    # The first, unless it is a part only; at a turning point an acquisition more belongs to either.
    reference = next(each for each, count in zip(passes, counts, strict=True) if count >= _LEAST_SHARE * max(counts))
    for each in passes:
        if each is reference:
            continue
        fit = _shifted(
            *_curve(angles_deg, intensities, reference.chosen), *_curve(angles_deg, intensities, each.chosen)
        )
        shift_deg = fit.shift_deg
        if not fit.is_proven:
            if fit.is_doubted:
                note(
                    path,
                    f"{each.name} may show the curve {shift_deg:+.2f} ± {fit.sigma_deg:.2f} deg from {reference.name}, "
                    "which their noise hides; they are used together, and the answer may be half of it off",
                )
            continue
        kept &= ~each.chosen
        left_out = int(each.chosen.sum())
        note(
            path,
            f"the scan has several passes that differ: {each.name} shows the same curve "
            f"{abs(shift_deg):.2f} deg {'above' if shift_deg > 0 else 'below'} {reference.name}, as after a backlash, "
            f"a late reading of the angle, or a marker that moved; {each.name} is left out ({left_out} of "
            f"{angles_deg.size} acquisitions), and the answer is an angle of {reference.name}",
        )
    return kept


def _passes(angles_deg: Float64[np.ndarray, " n"]) -> list[_Pass]:
    """Return the passes that can be compared; NaN belongs to none."""
    numbers = _turned(angles_deg)
    found = [numbers == number for number in range(int(numbers.max(initial=-1)) + 1)]
    found = [each for each in found if each.sum() >= _FEWEST]
    if len(found) < 2:
        return _sorted_passes(angles_deg)
    rising = [bool(angles_deg[each][-1] > angles_deg[each][0]) for each in found]
    if len(set(rising)) == 2:
        # All passes in one direction are one.
        return [
            _Pass(
                name=f"the pass of {word} angles",
                chosen=np.any([each for each, up in zip(found, rising, strict=True) if up == wanted], axis=0),
            )
            for wanted, word in sorted(((True, "rising"), (False, "falling")), key=lambda each: each[0] != rising[0])
        ]
    return [_Pass(name=f"the {_ordinal(number + 1)} pass", chosen=each) for number, each in enumerate(found)]


def _sorted_passes(angles_deg: Float64[np.ndarray, " n"]) -> list[_Pass]:
    """Return the two directions of a scan whose acquisitions were sorted by their angles, each in order of time."""
    occurrences = _occurrences(angles_deg)
    words = ("first", "second") if occurrences.max(initial=-1) < 2 else ("odd", "even")
    found = [
        _Pass(name=f"the {word} acquisition of each angle", chosen=(occurrences >= 0) & (occurrences % 2 == parity))
        for parity, word in enumerate(words)
    ]
    return found if min(each.chosen.sum() for each in found) >= _FEWEST else []


def _ordinal(number: int) -> str:
    return {1: "first", 2: "second", 3: "third"}.get(number, f"{number}th")


def _turned(angles_deg: Float64[np.ndarray, " n"]) -> Int64[np.ndarray, " n"]:
    """Return the number of the pass of each acquisition, from 0; -1 for NaN."""
    numbers = np.full(angles_deg.size, -1)
    places = np.flatnonzero(~np.isnan(angles_deg))
    if not places.size:
        return numbers
    ends = _ends(angles_deg[places].tolist())
    found = np.searchsorted(np.array(ends, dtype=int), np.arange(places.size), side="left")
    lengths = np.bincount(found)
    # The way back of a scan that always rises is a single step, to the first angle of the next pass.
    for number in np.flatnonzero(lengths < _FEWEST).tolist():
        if number + 1 < lengths.size and lengths[number + 1] >= _FEWEST:
            found[found == number] = number + 1
    numbers[places] = found
    return numbers


def _ends(angles_deg: list[float]) -> list[int]:
    """Return the indices at which the probe turned back by more than half of the range."""
    half_deg = (max(angles_deg) - min(angles_deg)) / 2
    ends: list[int] = []
    low = 0
    high = 0
    sense = 0
    for index, angle_deg in enumerate(angles_deg):
        low = min(low, index, key=angles_deg.__getitem__)
        high = max(high, index, key=angles_deg.__getitem__)
        falls = angles_deg[high] - angle_deg > half_deg
        rises = angle_deg - angles_deg[low] > half_deg
        if (falls and sense >= 0) or (rises and sense <= 0):
            end = high if falls else low
            if sense or end:
                ends.append(end)
            sense = -1 if falls else 1
            low = index
            high = index
    # A scan may begin and end in the middle of its range.
    return [*ends, low if sense < 0 else high] if sense else ends


def _occurrences(angles_deg: Float64[np.ndarray, " n"]) -> Int64[np.ndarray, " n"]:
    """Return how many acquisitions at the same angle came before each; -1 for NaN."""
    numbers = np.full(angles_deg.size, -1)
    order = np.argsort(angles_deg, kind="stable")
    order = order[: np.count_nonzero(~np.isnan(angles_deg))]
    new = np.diff(angles_deg[order], prepend=-np.inf) >= MIN_STEP_DEG
    starts = np.flatnonzero(new)
    numbers[order] = np.arange(order.size) - np.repeat(starts, np.diff(starts, append=order.size))
    return numbers


def _curve(
    angles_deg: Float64[np.ndarray, " n"], intensities: Float64[np.ndarray, " n"], chosen: Bool[np.ndarray, " n"]
) -> tuple[Float64[np.ndarray, " angles"], Float64[np.ndarray, " angles"]]:
    """Return the angles of a pass in rising order, and the mean intensity at each."""
    angles, places = np.unique(angles_deg[chosen], return_inverse=True)
    return angles, np.bincount(places, intensities[chosen]) / np.bincount(places)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fit:
    """A pass as another one, shifted by so much, times a gain, plus a level."""

    shift_deg: float
    likeness: float
    """Share of the variance that it explains."""
    sigma_deg: float
    """Standard deviation of the shift, also where the scatter grows with the intensity."""

    def _is(self, least_deg: float, least_sigmas: float) -> bool:
        # Written so that NaN proves nothing.
        least_deg = max(least_deg, least_sigmas * self.sigma_deg)
        return self.likeness >= _LEAST_LIKENESS and abs(self.shift_deg) >= least_deg

    @property
    def is_proven(self) -> bool:
        """Whether one of the two is to be left out."""
        return self._is(_LEAST_SHIFT_DEG, _LEAST_SIGMAS)

    @property
    def is_doubted(self) -> bool:
        """Whether the shift is to be named."""
        return self._is(_DOUBTED_DEG, _DOUBTED_SIGMAS)


def _shifted(
    angles_deg: Float64[np.ndarray, " n"],
    intensities: Float64[np.ndarray, " n"],
    others_deg: Float64[np.ndarray, " m"],
    others: Float64[np.ndarray, " m"],
) -> _Fit:
    """Return the shift at which the curve of `others` is best explained by that of `intensities`."""
    if min(angles_deg.size, others_deg.size) < _FEWEST:
        return _Fit(shift_deg=0.0, likeness=0.0, sigma_deg=np.inf)
    most_deg = _MOST_SHIFT * float(np.ptp(angles_deg))
    step_deg = max(float(np.median(np.diff(angles_deg))) / 2, 2 * most_deg / _MOST_TRIED)

    def fit(shift_deg: float) -> _Fit:
        return _fit(angles_deg, intensities, others_deg, others, shift_deg)

    coarse = max(map(fit, np.arange(-most_deg, most_deg + step_deg / 2, step_deg)), key=lambda each: each.likeness)
    about = coarse.shift_deg + np.linspace(-step_deg, step_deg, 41)
    return max([coarse, *map(fit, about)], key=lambda each: each.likeness)


def _fit(
    angles_deg: Float64[np.ndarray, " n"],
    intensities: Float64[np.ndarray, " n"],
    others_deg: Float64[np.ndarray, " m"],
    others: Float64[np.ndarray, " m"],
    shift_deg: float,
) -> _Fit:
    """Return how well one shift explains `others`, least squares in gain and level."""
    at_deg = others_deg - shift_deg
    inside = (at_deg >= angles_deg[0]) & (at_deg <= angles_deg[-1])
    if inside.sum() < max(_FEWEST, others.size / 2):
        return _Fit(shift_deg=shift_deg, likeness=0.0, sigma_deg=np.inf)
    at_deg = at_deg[inside]
    read = others[inside] - others[inside].mean()
    curve = np.interp(at_deg, angles_deg, intensities)
    slope = np.interp(at_deg, angles_deg, np.gradient(intensities, angles_deg))
    # Noise of an interpolated value is less than that of one of the two; without this, half steps are preferred.
    place = np.clip(np.searchsorted(angles_deg, at_deg) - 1, 0, angles_deg.size - 2)
    share = (at_deg - angles_deg[place]) / (angles_deg[place + 1] - angles_deg[place])
    noise = (1 + share**2 + (1 - share) ** 2) / 2
    centred = curve - curve.mean()
    gain = float(centred @ read) / max(float(centred @ centred), np.finfo(float).tiny)
    rest = read - gain * centred
    total = float(read @ read)
    if gain <= 0 or total == 0:
        return _Fit(shift_deg=shift_deg, likeness=0.0, sigma_deg=np.inf)
    # Sandwich estimate of White: it does not assume that the scatter is the same at all angles.
    # Of the two slopes the noise is not that of one curve, so that their product holds no square of it.
    lean = gain * (slope - slope.mean())
    known = float(lean @ np.interp(at_deg, others_deg - shift_deg, np.gradient(others, others_deg)))
    scatter = float(np.sqrt((lean**2) @ (rest**2) * rest.size / (rest.size - 3)))
    sigma_deg = scatter / known if known > 0 else np.inf
    return _Fit(shift_deg=shift_deg, likeness=1 - float((rest**2 / noise).sum()) / total, sigma_deg=sigma_deg)
