"""``markerseek tooltip`` on PNG, DICOM and Ultrasonix files: an answer or a sentence, whatever is in the folder."""

from __future__ import annotations

import json
import struct

import cv2
import numpy as np
import pytest

from tests.tip_images import dicom, images_of_a_tip

ANGLES = np.arange(-6.0, 7.0)


@pytest.fixture(scope="module")
def images():
    return list(images_of_a_tip(ANGLES))


@pytest.fixture
def folder(tmp_path, images):
    (tmp_path / "scan").mkdir()
    for number, image in enumerate(images):
        cv2.imwrite(str(tmp_path / "scan" / f"{number:02d}.png"), image)
    return tmp_path / "scan"


def answer(shell, *words):
    code, out, err = shell("tooltip", *words, "--json")
    assert code in (0, 3), err
    return json.loads(out)


def same(one, other):
    return all(one[key] == other[key] for key in ("found", "reference_deg", "half_range_deg", "below_deg", "above_deg"))


def test_a_folder_gives_the_range_and_a_picture(shell, folder, tmp_path):
    code, out, _ = shell("tooltip", folder, "--first-deg", -6, "--pixel-mm", 0.15, "--plot", "--out", tmp_path)
    assert (code, "tip found" in out) == (0, True)
    assert (tmp_path / "scan-tip.png").exists()
    assert all(f"{number:02d}.png" in out for number in range(len(ANGLES)))
    report = answer(shell, folder, "--first-deg", -6, "--pixel-mm", 0.15)
    assert report["found"]
    assert abs(report["reference_deg"]) <= 1
    assert 2 <= report["half_range_deg"] <= 5
    assert report["full_range_deg"] == report["below_deg"] + report["above_deg"]
    assert [each["angle_deg"] for each in report["images"]] == ANGLES.tolist()
    assert report["version"]


def test_angles_come_from_a_file_by_name_or_in_order(shell, folder, tmp_path):
    expected = answer(shell, folder, "--first-deg", -6)
    assert expected["pixel_size"].startswith("assumed")
    by_order = tmp_path / "order.txt"
    by_order.write_text("".join(f"{angle}\n" for angle in ANGLES))
    by_name = tmp_path / "names.csv"
    lines = [f"{number:02d}.png,{angle}" for number, angle in enumerate(ANGLES)]
    by_name.write_text("file,angle_deg\n" + "\n".join(reversed(lines)) + "\n")
    assert same(answer(shell, folder, "--angles", by_order), expected)
    assert same(answer(shell, folder, "--angles", by_name), expected)


def test_eight_and_sixteen_bits_png_b8_and_dicom_agree(shell, folder, images, tmp_path):
    expected = answer(shell, folder, "--first-deg", -6, "--pixel-mm", 0.15)
    deep = tmp_path / "deep"
    deep.mkdir()
    for number, image in enumerate(images):
        cv2.imwrite(str(deep / f"{number:02d}.png"), image.astype(np.uint16) * 100)
    colour = tmp_path / "colour"
    colour.mkdir()
    for number, image in enumerate(images):
        cv2.imwrite(str(colour / f"{number:02d}.png"), cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    stack = np.stack(images)
    rows, columns = stack.shape[1:]
    head = struct.pack("<19i", 4, len(stack), columns, rows, 8, *[0] * 8, 2, 5, 0, 30, 128, 0)
    (tmp_path / "scan.b8").write_bytes(head + stack.tobytes())
    dicom(tmp_path / "scan.dcm", stack, PixelSpacing=[0.15, 0.15])
    dicom(tmp_path / "deep.dcm", stack.astype(np.uint16) * 257)
    for place, extra in (
        (deep, ("--pixel-mm", 0.15)),
        (colour, ("--pixel-mm", 0.15)),
        (tmp_path / "scan.b8", ("--pixel-mm", 0.15)),
        (tmp_path / "scan.dcm", ()),
        (tmp_path / "deep.dcm", ("--pixel-mm", 0.15)),
    ):
        report = answer(shell, place, "--first-deg", -6, *extra)
        assert report["found"]
        # The scale of grey values differs where 16 bits are stretched to the whole range, and with it the last digit.
        assert abs(report["half_range_deg"] - expected["half_range_deg"]) <= 0.5
    assert answer(shell, tmp_path / "scan.dcm")["pixel_size"] == "from the files"


def test_a_rectangle_can_be_named(shell, folder):
    expected = answer(shell, folder, "--first-deg", -6, "--pixel-mm", 0.15)
    roi = ",".join(str(each) for each in expected["rectangle"])
    assert same(answer(shell, folder, "--first-deg", -6, "--pixel-mm", 0.15, "--roi", roi), expected)


def test_the_paper_s_way_is_asked_for_by_name(shell, folder):
    by_default = answer(shell, folder, "--first-deg", -6, "--pixel-mm", 0.15)
    published = answer(shell, folder, "--first-deg", -6, "--pixel-mm", 0.15, "--as-published")
    # The last image in which the centroid exceeds three deviations, and not the angle at which the echo is lost.
    assert published["half_range_deg"] in (3.0, 3.5)
    assert published["half_range_deg"] < by_default["half_range_deg"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--roi", "1,2,3"), "write four whole numbers"),
        (("--roi", "5000,5,40,40"), "outside of the image"),
        (("--step-deg", 0), "must be finite and not 0"),
        (("--step-deg", 90), "the last angle is 1080"),
        (("--pixel-mm", 0), "--pixel-mm is 0.0"),
        (("--angles", "few.txt"), "2 angles for 13 images"),
        (("--angles", "words.txt"), "'x' is no angle in degrees"),
        (("--angles", "names.csv"), "there is no angle of 00.png"),
        (("--angles", "comma.csv"), "one or two columns are expected"),
        (("--angles", "few.txt", "--step-deg", 2), "leave --step-deg and --first-deg out"),
    ],
)
def test_what_does_not_fit_is_a_sentence(shell, folder, monkeypatch, words, message):
    monkeypatch.chdir(folder.parent)
    (folder.parent / "few.txt").write_text("1\n2\n")
    (folder.parent / "words.txt").write_text("1\nx\n")
    (folder.parent / "comma.csv").write_text("00.png,-1,5\n")
    (folder.parent / "names.csv").write_text("file,angle_deg\nother.png,3\n")
    code, _, err = shell("tooltip", folder, *words)
    assert (code, message in err) == (2, True), err


def test_folders_and_files_that_hold_no_series_are_a_sentence(shell, tmp_path, images):
    empty = tmp_path / "empty"
    empty.mkdir()
    one = tmp_path / "one"
    one.mkdir()
    cv2.imwrite(str(one / "a.png"), images[0])
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    cv2.imwrite(str(mixed / "a.png"), images[0])
    cv2.imwrite(str(mixed / "b.png"), images[0][:100])
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "a.png").write_bytes(b"\x89PNG\r\n\x1a\nand then nothing")
    (tmp_path / "a.dcm").write_bytes(b"no DICOM at all")
    (tmp_path / "a.txt").write_text("text")
    for place, message in (
        (empty, "there is no image in this folder; .png, .dcm, .b8 are read"),
        (one, "1 image, at least 2 are needed"),
        (mixed, "image 2 has 100 ×"),
        (broken, "it is damaged"),
        (tmp_path / "a.dcm", "a.dcm: no image that can be read"),
        (tmp_path / "a.txt", "export the images as one of these"),
        (tmp_path / "nothing.png", "check the name"),
    ):
        code, _, err = shell("tooltip", place)
        assert (code, message in err) == (2, True), (place, err)


def test_two_sizes_of_pixels_are_no_scan(shell, tmp_path, images):
    for name, size in (("a", 0.1), ("b", 0.2)):
        (tmp_path / "scan").mkdir(exist_ok=True)
        dicom(tmp_path / "scan" / f"{name}.dcm", images[0][None], PixelSpacing=[size, size])
    code, _, err = shell("tooltip", tmp_path / "scan")
    assert (code, "a pixel of a.dcm is 0.1 × 0.1 mm" in err) == (2, True), err
