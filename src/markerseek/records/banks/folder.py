"""Reads a bank from a folder with one SonixDAQ sub-folder, or one file of channel data, for each angle."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from markerseek.core import ChannelFrame, RecordError
from markerseek.records.banks.arrays import USUAL_SAMPLING_HZ
from markerseek.records.banks.bank import BankFacts, FrameBank, require_angles
from markerseek.records.banks.counts import EXACT, scale_of
from markerseek.records.banks.frames import MAT_PROBE, load_frame, npy_samples
from markerseek.records.sandbox import Sandbox

_FRAME_FILES = (".mat", ".npy")
_NAME = re.compile(
    r"(?P<word>[a-z_ ]*)(?P<angle>(?<![a-z])[-+](?:\d+(?:\.\d+)?|\.\d+)|\d+(?:\.\d+)?|\.\d+)[_ ]?(?:deg|°)?",
    re.ASCII | re.IGNORECASE,
)
# "neg_12.5" or "m12.5" would be read as +12.5: the sign of an angle is never guessed.
_SIGN_WORDS = re.compile(r"(?:^|[_ ])(?:m|n|p)$|(?:neg|negative|minus|pos|positive|plus)$")


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderBank(FrameBank):
    """One acquisition for each angle, in a folder or file of its own."""

    places: tuple[Path, ...] = field(repr=False)
    """Path of each, in the order of the angles."""
    sandbox: Sandbox = field(repr=False, compare=False, default_factory=Sandbox)
    """Process that reads the files of NumPy and MATLAB."""
    scale: float = EXACT
    """Counts of one unit in files of NumPy, the same at all angles."""

    def frame(self, index: int) -> ChannelFrame:
        """Channel data of one angle, from the disk.

        Raises `RecordError` if they cannot be read.
        """
        sampling_hz = self.facts.sampling_hz or USUAL_SAMPLING_HZ
        angle_deg = self.angles_deg[index]
        return load_frame(
            self.places[index], sampling_hz=sampling_hz, angle_deg=angle_deg, sandbox=self.sandbox, scale=self.scale
        )

    def dark_frame(self, index: int) -> ChannelFrame:
        """Not available: such a folder holds no frames without laser."""
        raise RecordError(f"{self.places[0].parent}: there is no dark frame {index + 1}, it holds none")


def read_folder(path: Path) -> FolderBank:
    """Bank in a folder, from the names of its sub-folders and files of channel data.

    A name is the angle in degrees, such as ``-12.5``, optionally with a word before it, the same in the whole folder,
    and ``deg`` or ``°`` after it: ``angle_-12.5deg``.
    """
    by_angle: dict[float, Path] = {}
    words: dict[str, Path] = {}
    for place in sorted(path.iterdir()):
        # Hidden files such as .DS_Store, but not an angle such as .5.
        if re.match(r"\.\D", place.name) or not (place.is_dir() or place.suffix.lower() in _FRAME_FILES):
            continue
        word, angle = _named(place)
        if word:
            words.setdefault(word, place)
        # "left_10" and "right_10" would become one angle: two words may stand for two signs.
        if len(words) > 1:
            first = next(iter(words.values()))
            raise RecordError(
                f"{place}: its name has another word than {first.name}; if the words are the two sides, write "
                "negative angles with a sign, as in 'angle_-12.5deg', and the same word everywhere"
            )
        if angle in by_angle:
            raise RecordError(f"{place}: the angle {angle:g} deg is that of {by_angle[angle].name}")
        by_angle[angle] = place
    if not by_angle:
        raise RecordError(
            f"{path}: there is no scan in this folder; it must hold one folder or file of channel data for each angle, "
            "with the angle in its name, as in 'angle_-12.5deg'"
        )
    angles = sorted(by_angle)
    require_angles(path, angles)
    places = tuple(by_angle[angle] for angle in angles)
    facts = BankFacts(probe=MAT_PROBE if all(place.suffix.lower() == ".mat" for place in places) else None)
    sandbox = Sandbox()
    scale = _common_scale(path, [place for place in places if place.suffix.lower() == ".npy"], sandbox)
    return FolderBank(angles_deg=tuple(angles), places=places, facts=facts, sandbox=sandbox, scale=scale)


def _common_scale(path: Path, places: list[Path], sandbox: Sandbox) -> float:
    """Counts of one unit for all files of NumPy; they are all read only if the first does not hold int16."""
    if not places or npy_samples(places[0], sandbox).dtype == np.int16:
        return EXACT
    return scale_of(path, (npy_samples(place, sandbox) for place in places))


def _named(place: Path) -> tuple[str, float]:
    """Word and angle of a name."""
    name = place.name if place.is_dir() else place.stem
    match = _NAME.fullmatch(name)
    word = match["word"].strip("_ ").lower() if match else ""
    if match is None or _SIGN_WORDS.search(word):
        raise RecordError(
            f"{place}: the angle cannot be read from this name; it must be a word, or none, and then degrees in plain "
            "digits with a point and, below zero, a hyphen as the sign, set off from the word: -12.5 or angle_-12.5deg"
        )
    return word, float(match["angle"])
