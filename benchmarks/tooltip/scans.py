"""B-mode scans of an instrument's tip on tissue, made without any code of `markerseek`.

Layers as in Fig. 9 of the paper: gel pad, tissue, air. Scatterers are discrete (Poisson) with random phases, drawn for
each half degree, blurred by pulse and beam, and summed over the elevational beam; the envelope of many is
Rayleigh distributed (R. F. Wagner et al., IEEE Trans. Sonics Ultrason. 30, 156 (1983)). The surface of the tissue is
a specular line, brightest where the beam meets it upright. The tip is a rough reflector of 1 to 5 mm at the surface,
with reverberations behind it (comet tail). Between scans, beam, layers, gain, grey map, motion, shadows, saturation,
pixels and orientation differ.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import count

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

SLICE_DEG = 0.5
Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """Images at their angles, and the truth about the tip."""

    angles_deg: list[float]
    images: list[NDArray[np.uint8]]
    pixel_m: tuple[float, float]
    tip: bool
    saturated: bool
    """Whether the gain drives the tip beyond white; in a scan without a tip, the surface of the tissue."""
    tissue_white: float
    """Share of the tissue's pixels that are white."""
    reference_deg: float
    half_deg: float
    """Angle from the reference at which the tip's echo equals, in power over its face, the echo of what surrounds it:
    beyond, it is lost in the speckle. NaN without a tip."""
    places: list[tuple[float, float]]
    """Row and column of the middle of the tip in each image."""
    roi: tuple[int, int, int, int]
    """A rectangle as a person draws it around the tip where it is brightest: row, column, rows, columns."""
    kind: str
    """What is special: ``one side``, ``motion``, ``shadow``, ``saturated``."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """Ranges from which scans are drawn; development and test differ."""

    beam_deg: tuple[float, float]
    """Full width at half amplitude of the two-way elevational beam."""
    contrast_db: tuple[float, float]
    """Tip over tissue, in power over the tip's face, at the reference."""
    pixel_mm: tuple[float, float]
    tip_mm: tuple[float, float]
    profiles: tuple[str, ...]
    """Forms of the beam: ``gaussian``, ``lobes``, ``tails``, ``aperture``."""
    depth_mm: tuple[float, float]


DEVELOPMENT = Family(
    beam_deg=(2.6, 5.5),
    contrast_db=(17.0, 34.0),
    pixel_mm=(0.11, 0.2),
    tip_mm=(1.2, 5.0),
    profiles=("gaussian", "lobes"),
    depth_mm=(28.0, 52.0),
)
TEST = Family(
    beam_deg=(2.4, 6.0),
    contrast_db=(16.0, 36.0),
    pixel_mm=(0.1, 0.22),
    tip_mm=(1.0, 5.0),
    profiles=("gaussian", "lobes", "tails", "aperture"),
    depth_mm=(25.0, 55.0),
)


def _beam(profile: str, width_deg: float, off_deg: Floats) -> Floats:
    """Two-way amplitude of the elevational beam, 1 in the plane."""
    x = np.abs(np.asarray(off_deg)) / width_deg
    main = np.exp(-4 * math.log(2) * x**2)
    if profile == "lobes":
        return main + 10 ** (-30 / 20) * np.exp(-4 * math.log(2) * ((x - 1.7) / 0.6) ** 2)
    if profile == "tails":
        return 0.985 * main + 0.015 / (1 + (2 * x) ** 2)
    if profile == "aperture":
        # Transmit and receive of one uniform aperture: sinc squared; half amplitude at 0.443 of its first zero.
        return np.sinc(0.886 * x) ** 2
    return main


LEAST_HALF_DEG = 1.5


def make_scan(family: Family, seed: int, *, tip: bool) -> Scan:
    """One scan; equal arguments give equal scans.

    A tip that its surroundings outshine within `LEAST_HALF_DEG` of the reference cannot be seen, and is drawn again.
    """
    key = [seed, int(tip), round(1000 * family.beam_deg[0])]
    attempts = (_draw_scan(family, np.random.default_rng([*key, attempt]), tip=tip) for attempt in count())
    return next(scan for scan in attempts if not tip or scan.half_deg >= LEAST_HALF_DEG)


def _draw_scan(family: Family, rng: np.random.Generator, *, tip: bool) -> Scan:  # noqa: C901, one scene
    u = rng.uniform
    height_mm = u(*family.pixel_mm)
    width_mm = height_mm * rng.choice([1.0, u(0.75, 1.6)])
    face_mm = u(8, 12)
    depth_mm = u(*family.depth_mm)
    radius_mm = face_mm + depth_mm
    reference_deg = u(-20, 20)
    step_deg = float(rng.choice([0.5, 1.0, 1.0, 1.0, 1.5]))
    one_side, motion, shadow = rng.random(3) < (0.3, 0.3, 0.3)
    saturation = rng.random()
    profile = str(rng.choice(family.profiles))
    beam_deg = u(*family.beam_deg)
    size_mm = u(*family.tip_mm)
    contrast_db = u(*family.contrast_db)
    thick_mm = size_mm * u(0.35, 0.6)
    pressed_mm = u(0, 3)
    tissue_mm = u(8, 22)

    # The tip's power over the angle: strips of its face, each seen with the beam.
    strips_mm = np.linspace(-size_mm / 2, size_mm / 2, 15)[1:-1]
    weights = np.sqrt(1 - (2 * strips_mm / size_mm) ** 2)
    strips_deg = np.degrees(strips_mm / radius_mm)

    def seen(off_deg: float) -> float:
        return float(weights @ _beam(profile, beam_deg, off_deg - strips_deg) ** 2)

    # Angles: around the tip or, as in the paper, from the reference to one side.
    fine = np.arange(0, 25, 0.02)
    curve_db = np.array([10 * math.log10(seen(t) / seen(0.0) + 1e-12) for t in fine]) + contrast_db
    rough_half = float(fine[np.argmax(curve_db < 0)])
    beyond = rough_half + step_deg * rng.integers(3, 8, 2) + (0 if one_side else u(0, 2, 2))
    number = np.arange(0, math.ceil(beyond[0] / step_deg) + 1)
    grid = number * step_deg
    if one_side:
        angles_off = grid * rng.choice([-1, 1])
    else:
        down = -np.arange(1, math.ceil(beyond[1] / step_deg) + 1) * step_deg
        angles_off = np.concatenate([down[::-1], grid]) + u(-0.5, 0.5) * step_deg
    angles = np.sort(np.round(reference_deg + angles_off, 3))
    steps = len(angles)

    first_mm = max(2.0, depth_mm - u(12, 26))
    rows = round((depth_mm + u(8, 20) - first_mm) / height_mm)
    columns = round(u(30, 48) / width_mm)
    row_mm = first_mm + np.arange(rows) * height_mm
    column_mm = (np.arange(columns) - (columns - 1) / 2) * width_mm
    lateral_mm = u(-0.28, 0.28) * columns * width_mm

    # Motion of the hand or of breathing, the same for all that is in an image.
    jitter_mm = u(0.1, 0.4) * rng.standard_normal((steps, 2)) + np.outer(np.linspace(-1, 1, steps), u(-0.7, 0.7, 2))
    if not motion:
        jitter_mm = np.zeros((steps, 2))

    # Surfaces: level in the room, so that a turned plane cuts them farther away; uneven along the array.
    surface_height_mm = radius_mm * math.cos(math.radians(reference_deg)) + pressed_mm
    slope = math.tan(math.radians(u(-3, 3)))
    waves = u(0, 0.5)
    along = column_mm * slope + waves * np.sin(2 * np.pi * (column_mm / u(12, 30) + rng.random()))
    along -= np.interp(lateral_mm, column_mm, along)
    interface_db = u(3, 20)
    interface_mm = u(0.18, 0.45)
    pad_db = u(-35, -16)
    air_db = u(-40, -26)
    gloss = _smooth(rng, (steps, columns), (3.0 / step_deg, 2.0 / width_mm)) * u(0.5, 3)
    pad_line_db = u(-10, 8)
    # Bands of fibre in the tissue, and small bright places that are seen as long as the beam sees them.
    bands = [(u(0.1, 0.9), u(-0.5, 0.5), u(3, 12), u(4, 12), u(-0.15, 0.15), u(0.15, 0.3), u(-12, 12), u(4, 12))
             for _ in range(rng.integers(0, 6))]  # fmt: skip
    spots = [(u(0.1, 0.95), u(-0.5, 0.5), u(angles[0], angles[-1]), u(5, 13)) for _ in range(rng.integers(0, 5))]
    shade_at = u(-0.5, 0.5) * columns * width_mm
    shade_mm = u(2, 5)
    shade_db = u(6, 18)
    shade_from_mm = first_mm + u(0, 10)
    tgc_db = u(-0.25, 0.25)
    noise_db = u(-38, -26)
    range_db = u(45, 70)
    gamma = rng.choice([1.0, 1.0, 1.0, u(0.85, 1.2)])
    strength_db = contrast_db if tip else interface_db + 10
    is_saturated = saturation < 0.3
    white_db = strength_db - u(2, 12) if is_saturated else strength_db + u(3, 9)
    if saturation < 0.04:
        # Everything is too bright.
        white_db = u(-1, 4)

    tissue = _tissue(rng, angles, rows, columns, profile, beam_deg, row_mm, height_mm, width_mm)
    rough = u(0.15, 0.6)
    grain = _blur(_white(rng, (steps, rows, columns)), row_mm, height_mm, width_mm)
    grain = gaussian_filter1d(grain, beam_deg / step_deg / 2.35, axis=0)
    grain /= np.sqrt(np.mean(np.abs(grain) ** 2))
    tail_mm = u(1.5, 6)
    tail_db = u(3, 12)
    ring_mm = u(0.6, 1.6)
    tail_width = u(0.4, 0.9)
    tilt = math.radians(u(-15, 15))
    phase = np.exp(2j * np.pi * rng.random())

    images = []
    places = []
    backgrounds = []
    echoes = []
    for k, angle in enumerate(angles):
        off_deg = angle - reference_deg
        down = row_mm[:, None] - jitter_mm[k, 0]
        right = column_mm[None, :] - jitter_mm[k, 1]
        dent = pressed_mm if tip else 0.0
        dent = dent * np.exp(-(((right - lateral_mm) / (0.8 * size_mm)) ** 2) - (off_deg / 6) ** 2)
        surface = surface_height_mm / math.cos(math.radians(angle)) - face_mm + along[None, :] - dent
        below = surface - down
        level = np.where(below > tissue_mm, pad_db, np.where(below > 0, 0.0, air_db))
        amplitude = 10 ** (level / 20)
        specular = interface_db + gloss[k] - (angle / 14) ** 2 * 3
        line = 10 ** (specular / 20) * np.exp(-0.5 * (below / interface_mm) ** 2)
        ghost = 10 ** ((specular - 22) / 20) * np.exp(-0.5 * ((below + 2.5) / 0.8) ** 2)
        pad_line = 10 ** (pad_line_db / 20) * np.exp(-0.5 * ((below - tissue_mm) / 0.3) ** 2)
        for depth, place, long_mm, db, lean, thin_mm, middle_deg, wide_deg in bands:
            distance = below - depth * tissue_mm - lean * right
            within = np.exp(-0.5 * ((right - place * columns * width_mm) / (long_mm / 2.35)) ** 2)
            turned = math.exp(-0.5 * ((angle - reference_deg - middle_deg) / wide_deg) ** 2)
            amplitude = amplitude + (10 ** (db / 20) - 1) * turned * within * np.exp(-0.5 * (distance / thin_mm) ** 2)
        factor = np.sqrt(amplitude**2 + line**2 + ghost**2 + pad_line**2)
        field = tissue[k] * factor
        for depth, place, at_deg, db in spots:
            row0 = surface_height_mm - depth * tissue_mm - face_mm
            column0 = place * columns * width_mm
            spot = np.exp(-0.5 * ((down - row0) / 0.16) ** 2 - 0.5 * ((right - column0) / 0.35) ** 2)
            field = field + 10 ** (db / 20) * float(_beam(profile, beam_deg, np.array(angle - at_deg))) * spot * phase
        slant_mm = math.sqrt(face_mm**2 + radius_mm**2 - 2 * face_mm * radius_mm * math.cos(math.radians(off_deg)))
        y = down - slant_mm
        x = right - lateral_mm
        turned_x = x * math.cos(tilt) + y * math.sin(tilt)
        turned_y = y * math.cos(tilt) - x * math.sin(tilt)
        body = 0.5 - 0.5 * np.tanh(3 * (np.hypot(turned_x / (size_mm / 2), turned_y / (thick_mm / 2)) - 1))
        tail = (y > 0) * np.exp(-np.maximum(y, 0) / tail_mm) * np.exp(-0.5 * (x / (tail_width * size_mm / 2)) ** 2)
        tail = tail * (0.65 + 0.35 * np.cos(2 * np.pi * y / ring_mm)) * 10 ** (-tail_db / 20)
        shape = np.maximum(body, tail) * (math.sqrt(1 - rough) + math.sqrt(rough) * grain[k])
        echo = 10 ** (contrast_db / 20) * math.sqrt(seen(off_deg) / seen(0.0)) * shape * phase
        face = body > 0.5
        backgrounds.append(float(np.mean(factor[face] ** 2)) if face.any() else math.nan)
        echoes.append(float(np.mean(body[face] ** 2)) * seen(off_deg) / seen(0.0) if face.any() else math.nan)
        if tip:
            # Metal hides what is behind it, as far as the beam is on the instrument.
            hidden = float(_beam(profile, beam_deg, np.array(off_deg)))
            field = field * (1 - 0.8 * hidden * np.maximum(body, tail)) + echo
        if shadow:
            across = np.exp(-((np.abs(right - shade_at - 0.05 * off_deg) / shade_mm) ** 4))
            field = field * 10 ** (-shade_db / 20 * across * (down > shade_from_mm))
        noise = _blur(_white(rng, (1, rows, columns)), row_mm, height_mm, width_mm)[0]
        field = field + 10 ** ((noise_db + 0.15 * (row_mm - depth_mm)[:, None]) / 20) * noise
        db = 20 * np.log10(np.abs(field) + 1e-9) + tgc_db * (row_mm - depth_mm)[:, None]
        grey = np.clip(1 + (db - white_db) / range_db, 0, 1) ** gamma
        images.append(np.round(255 * grey).astype(np.uint8))
        places.append(
            (
                (slant_mm + jitter_mm[k, 0] - first_mm) / height_mm,
                (lateral_mm + jitter_mm[k, 1] - column_mm[0]) / width_mm,
            )
        )

    # The truth: where the tip's power over its face has fallen to that of its surroundings there.
    off = angles - reference_deg
    surround_db = 10 * np.log10(np.interp(fine, np.sort(np.abs(off)), np.array(backgrounds)[np.argsort(np.abs(off))]))
    face_db = 10 * math.log10(np.nanmean(np.array(echoes)[np.argmin(np.abs(off))] / seen(off[np.argmin(np.abs(off))])
                                         * seen(0.0)))  # fmt: skip
    lost = curve_db + face_db < surround_db
    half = float(fine[np.argmax(lost)]) if lost.any() else math.nan

    if rng.random() < 0.25:
        for image in images:
            _marks(image)
    flip = rng.random() < 0.4
    if flip:
        images = [image[::-1].copy() for image in images]
        places = [(rows - 1 - row, column) for row, column in places]
    nearest = int(np.argmin(np.abs(off)))
    margin = u(1.5, 4, 4)
    row, column = places[nearest]
    top = int(max(0, row - (thick_mm / 2 + margin[0]) / height_mm))
    left = int(max(0, column - (size_mm / 2 + margin[1]) / width_mm))
    bottom = int(min(rows, row + (thick_mm / 2 + margin[2]) / height_mm))
    right_end = int(min(columns, column + (size_mm / 2 + margin[3]) / width_mm))
    inside = np.abs(row_mm - depth_mm) < 6
    kinds = [("one side", one_side), ("motion", motion), ("shadow", shadow), ("saturated", is_saturated)]
    return Scan(
        angles_deg=angles.tolist(),
        images=images,
        pixel_m=(height_mm / 1e3, width_mm / 1e3),
        tip=tip,
        saturated=bool(is_saturated or saturation < 0.04),
        tissue_white=float(np.mean(images[-1][:: -1 if flip else 1][inside & (row_mm < depth_mm - 2)] == 255)),
        reference_deg=float(reference_deg),
        half_deg=half if tip else math.nan,
        places=places,
        roi=(top, left, bottom - top, right_end - left),
        kind=", ".join(name for name, holds in kinds if holds) + f" [{profile}]",
    )


def _white(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.complex64]:
    """Complex Gaussian noise of mean square 1."""
    parts = rng.standard_normal((*shape, 2), dtype=np.float32) / np.float32(math.sqrt(2))
    return parts.view(np.complex64)[..., 0]


def _smooth(rng: np.random.Generator, shape: tuple[int, int], sigmas: tuple[float, float]) -> Floats:
    """Smooth Gaussian noise of standard deviation 1."""
    field = rng.standard_normal(shape)
    for axis, sigma in enumerate(sigmas):
        field = gaussian_filter1d(field, sigma, axis=axis, mode="nearest")
    return field / field.std()


def _blur(field: NDArray[np.complex64], row_mm: Floats, height_mm: float, width_mm: float) -> NDArray[np.complex64]:
    """Under pulse (0.28 mm) and beam, which widens with the depth from 0.45 mm to about 1 mm; mean square 1."""
    share = np.clip((row_mm - 15) / 50, 0, 1)[:, None].astype(np.float32)
    blurred = np.empty_like(field)
    for image, result in zip(field, blurred, strict=True):
        narrow, broad = (
            cv2.GaussianBlur(
                image.view(np.float32).reshape(*image.shape, 2),
                (0, 0),
                sigmaX=sigma / width_mm,
                sigmaY=0.12 / height_mm,
            )
            .reshape(image.shape[0], -1)
            .view(np.complex64)
            for sigma in (0.19, 0.40)
        )
        result[:] = (1 - share) * narrow / narrow.std() + share * broad / broad.std()
    blurred /= np.sqrt(np.mean(np.abs(blurred) ** 2, axis=(0, 2), keepdims=True))
    return blurred


def _tissue(rng, angles, rows, columns, profile, beam_deg, row_mm, height_mm, width_mm):  # type: ignore[no-untyped-def]
    """Speckle (angles, rows, columns) of mean square 1 of discrete scatterers, summed over the elevational beam."""
    low = angles[0] - 2.2 * beam_deg
    high = angles[-1] + 2.2 * beam_deg
    slices = np.arange(low, high, SLICE_DEG)
    # Density such that a resolution cell holds at least about ten scatterers: fully developed speckle.
    hit = rng.random((len(slices), rows, columns), dtype=np.float32) < 0.35
    scatterers = _blur(_white(rng, hit.shape) * hit, row_mm, height_mm, width_mm)
    beam = _beam(profile, beam_deg, angles[:, None] - slices[None, :]).astype(np.float32)
    beam /= np.sqrt(np.sum(beam**2, axis=1, keepdims=True))
    flat = scatterers.reshape(len(slices), -1)
    return (beam.astype(np.complex64) @ flat).reshape(len(angles), rows, columns)


def _marks(image: NDArray[np.uint8]) -> None:
    """A ruler and a line of text, as machines print them into their images."""
    image[8::40, -6:-1] = 255
    image[9::40, -4:-1] = 255
    for place in range(6, min(80, image.shape[1] - 10), 7):
        image[4:11, place : place + 4] = 230
