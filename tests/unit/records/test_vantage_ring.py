"""The ring of frames of a Vantage: gone round, not full, and with frames that never came."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from markerseek.core import ConfigError, RecordError
from markerseek.records.banks import IntensityBank, TableFormat
from markerseek.records.banks.arrays import ArrayBank, read_arrays
from tests.notes import noted
from tests.unit.records.vantage_workspaces import write_workspace

FRAMES = np.random.default_rng(7).integers(-2000, 2000, (12, 8, 40)).astype(np.int16)


FIRST_DEG = -35.0
STEP_DEG = 2.5


def with_gaps(*places: int) -> np.ndarray:
    """The frames, of which those at some places of the scan, counted from 0, never came."""
    frames = FRAMES.copy()
    frames[list(places)] = 0
    return frames


def place_of(samples: np.ndarray) -> int:
    """Place in the scan of a frame."""
    (place,) = np.flatnonzero((samples == FRAMES).all(axis=(1, 2)))
    return int(place)


def require_true_angles(bank: ArrayBank, places: list[int]) -> None:
    """Each frame has the angle at which it was taken."""
    assert [place_of(bank.frame(index).samples) for index in range(len(bank.angles_deg))] == places
    assert bank.angles_deg == tuple(FIRST_DEG + STEP_DEG * place for place in places)


def read(path: Path, **options: int) -> ArrayBank:
    bank = read_arrays(path, table=TableFormat(first_and_step_deg=(FIRST_DEG, STEP_DEG), **options))
    assert isinstance(bank, ArrayBank)
    return bank


@pytest.mark.parametrize("turned", [0, 1, 5, 11])
def test_a_ring_of_unknown_start_is_refused_until_a_person_says_where_it_begins(tmp_path: Path, turned: int) -> None:
    path = write_workspace(tmp_path / "run.mat", FRAMES, last=turned, last_saved=False)
    with pytest.raises(RecordError, match=r"lastFrame is missing.*save Resource.*`first_frame=1` if the ring has not"):
        read(path)
    require_true_angles(read(path, first_frame=turned + 1), list(range(12)))


@pytest.mark.parametrize("turned", [0, 1, 5, 11])
def test_a_ring_whose_last_frame_is_known_needs_no_word(tmp_path: Path, turned: int) -> None:
    require_true_angles(read(write_workspace(tmp_path / "run.mat", FRAMES, last=turned)), list(range(12)))


def test_a_person_outweighs_the_file(tmp_path: Path) -> None:
    path = write_workspace(tmp_path / "run.mat", FRAMES, last=4)
    first = read(path, first_frame=1).frame(0).samples
    assert place_of(first) == 8


def test_a_frame_that_is_not_in_the_ring_is_no_first_one(tmp_path: Path) -> None:
    path = write_workspace(tmp_path / "run.mat", FRAMES)
    with pytest.raises(ConfigError, match=r"`first_frame` is 13, the buffer has 1 to 12"):
        read(path, first_frame=13)
    np.savez(tmp_path / "scan.npz", frames=FRAMES)
    with pytest.raises(ConfigError, match=r"leave `first_frame` out"):
        read(tmp_path / "scan.npz", first_frame=1)


def test_the_axes_of_a_workspace_are_not_exchanged(tmp_path: Path) -> None:
    path = write_workspace(tmp_path / "run.mat", FRAMES)
    with pytest.raises(ConfigError, match="leave `axes` out"):
        read_arrays(
            path, table=TableFormat(first_and_step_deg=(FIRST_DEG, STEP_DEG), axes=("channels", "angles", "samples"))
        )


@pytest.mark.parametrize("step_deg", [STEP_DEG, -STEP_DEG])
@pytest.mark.parametrize("saved", [True, False])
@pytest.mark.parametrize("turned", [3, 5, 11])
def test_angles_that_begin_anew_are_in_the_order_of_the_buffer(
    tmp_path: Path, turned: int, saved: bool, step_deg: float
) -> None:
    angles_deg = np.roll(FIRST_DEG + 12 * abs(step_deg) + step_deg * np.arange(12), turned)
    path = write_workspace(
        tmp_path / "run.mat", FRAMES, last=turned, last_saved=saved, change=angles_beside(angles_deg)
    )
    bank = read_arrays(path)
    assert isinstance(bank, ArrayBank)
    places = [place_of(bank.frame(index).samples) for index in range(12)]
    assert places == (list(range(12)) if step_deg > 0 else list(range(11, -1, -1)))


def test_angles_that_begin_anew_elsewhere_than_the_ring_are_refused(tmp_path: Path) -> None:
    angles_deg = np.roll(FIRST_DEG + STEP_DEG * np.arange(12), 4)
    path = write_workspace(tmp_path / "run.mat", FRAMES, last=7, change=angles_beside(angles_deg))
    with pytest.raises(
        RecordError, match=r"the angles begin anew at frame 5, and the oldest frame is 8; name the fram"
    ):
        read_arrays(path)


@pytest.mark.parametrize("step_deg", [STEP_DEG, -STEP_DEG])
def test_angles_in_a_row_do_not_say_where_the_ring_begins(tmp_path: Path, step_deg: float) -> None:
    angles_deg = step_deg * np.arange(12)
    path = write_workspace(tmp_path / "run.mat", FRAMES, last=9, last_saved=False, change=angles_beside(angles_deg))
    with pytest.raises(RecordError, match=r"lastFrame is missing.*`first_frame=1` if the ring has not gone round, or"):
        read_arrays(path)
    bank = read_arrays(path, TableFormat(first_frame=10))
    assert place_of(bank.frame(0 if step_deg > 0 else 11).samples) == 0


def angles_beside(angles_deg: np.ndarray):
    def change(held):
        held.value(held.file, "angle_deg", angles_deg)

    return change


@pytest.mark.parametrize("saved", [True, False])
def test_a_ring_that_is_not_full_begins_with_its_first_frame(tmp_path: Path, saved: bool) -> None:
    path = write_workspace(tmp_path / "run.mat", with_gaps(7, 8, 9, 10, 11), last_saved=False)
    if saved:
        path = write_workspace(tmp_path / "last.mat", with_gaps(7, 8, 9, 10, 11), change=last_frame(7))
    with noted("5 frames hold zeros only, and are left out: 8, 9, 10, 11, 12"):
        require_true_angles(read(path), list(range(7)))


def test_intensities_beside_the_ring_need_no_place(tmp_path: Path) -> None:
    def change(held):
        held.value(held.file, "angle_deg", np.arange(4.0))
        held.value(held.file, "intensity", np.array([1.0, 2.0, 4.0, 2.0]))

    path = write_workspace(tmp_path / "run.mat", FRAMES, last_saved=False, change=change)
    bank = read_arrays(path, TableFormat(columns=("angle_deg", "intensity")))
    assert isinstance(bank, IntensityBank)
    assert bank.intensities == (1, 2, 4, 2)


def last_frame(number: int):
    def change(held):
        held.file["Resource/RcvBuffer/lastFrame"][...] = number

    return change


@pytest.mark.parametrize("turned", [0, 3, 9])
@pytest.mark.parametrize("lost", [(2, 5, 6), (0,), (0, 1, 11), (11,)])
def test_frames_that_never_came_leave_the_others_at_their_angles(
    tmp_path: Path, turned: int, lost: tuple[int, ...]
) -> None:
    path = write_workspace(tmp_path / "run.mat", with_gaps(*lost), last=turned)
    numbers = ", ".join(str(number) for number in sorted((place + turned) % 12 + 1 for place in lost))
    with noted(f"{len(lost)} frames hold zeros only, and are left out: {numbers}$"):
        require_true_angles(read(path), [place for place in range(12) if place not in lost])


def test_frames_lost_in_a_ring_that_is_not_full_keep_their_places(tmp_path: Path) -> None:
    path = write_workspace(tmp_path / "run.mat", with_gaps(2, 5, 8, 9, 10, 11), last_saved=False)
    with noted("6 frames hold zeros only, and are left out: 3, 6, 9, 10, 11 …"):
        require_true_angles(read(path), [0, 1, 3, 4, 6, 7])


def test_one_empty_frame_behind_the_last_is_either_lost_or_not_yet_filled(tmp_path: Path) -> None:
    """Of 12 frames the third never came, and frame 12 is empty: the oldest, lost, or the next to be filled."""
    path = write_workspace(tmp_path / "run.mat", with_gaps(2, 11), change=last_frame(11))
    with pytest.raises(RecordError, match=r"all frames behind the last, 11, hold zeros, and so do others.*first_frame"):
        read(path)
    with noted("left out: 3, 12"):
        require_true_angles(read(path, first_frame=1), [0, 1, 3, 4, 5, 6, 7, 8, 9, 10])


@pytest.mark.parametrize(("numbers", "left_out"), [(12, "4 frames"), (9, "1 frames")])
def test_a_variable_of_angles_counts_the_lost_frames(tmp_path: Path, numbers: int, left_out: str) -> None:
    """With a number for each frame of the buffer, or for those up to the last, behind which no frame has an angle."""
    angles_deg = FIRST_DEG + STEP_DEG * np.arange(numbers)
    frames = with_gaps(3, 9, 10, 11)

    def change(held):
        held.value(held.file, "angle_deg", angles_deg)
        last_frame(9)(held)

    with noted(f"{left_out} hold zeros only"):
        bank = read_arrays(write_workspace(tmp_path / "run.mat", frames, change=change))
    assert isinstance(bank, ArrayBank)
    require_true_angles(bank, [0, 1, 2, 4, 5, 6, 7, 8])
