"""Sequences of PLUS: angles, statuses, times and pixels, against SimpleITK and pynrrd; files that are damaged."""

from __future__ import annotations

import gzip
import math
import zlib
from pathlib import Path

import nrrd
import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813 - the name that its users give it
from scipy.spatial.transform import Rotation

from markerseek.bmode import read_image_sequence
from markerseek.core import ConfigError, RecordError
from markerseek.records.banks import TableFormat, read_bank, read_sequence, write_sequence
from markerseek.records.banks.sequence import angles_of, open_sequence
from tests.notes import noted, notes_collected
from tests.unit.records.banks.exported import ANGLES, FACTS, SERIES, TIMES, images

TURNED = (-10.0, -2.5, 0.0, 7.25, 20.0)
RF = {"kind": "RF_REAL", "orientation": "FM"}
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


def matrix(angle_deg, axis="z", shift=(1.0, 2.0, 3.0)):
    whole = np.eye(4)
    whole[:3, :3] = Rotation.from_rotvec(math.radians(angle_deg) * np.array(AXES[axis])).as_matrix()
    whole[:3, 3] = shift
    return " ".join(f"{value:.6g}" for value in whole.flat)


def fields(angles=TURNED, **more):
    """Fields of frames as a stepper of PLUS writes them; ``more``: field to one value for each frame."""
    frames = [
        {
            "ProbeRotation": f"{angle:g}",
            "ProbeToStepperHomeTransform": matrix(angle),
            "ProbeToStepperHomeTransformStatus": "OK",
            "Timestamp": f"{100 + 0.5 * number:.6f}",
            "ImageStatus": "OK",
        }
        for number, angle in enumerate(angles)
    ]
    for name, values in more.items():
        for frame, value in zip(frames, values, strict=True):
            frame.pop(name, None)
            if value is not None:
                frame[name] = value
    return frames


TYPES = {"u1": "MET_UCHAR", "i2": "MET_SHORT", "u2": "MET_USHORT", "f4": "MET_FLOAT"}


def write_mha(path, pixels, frames, *, packed=False, kind="", orientation="MFA", separate=False, **changed):
    """A MetaImage of pixels (frames, rows, columns) to the description of PLUS, written without any library."""
    order = ">" if changed.get("BinaryDataByteOrderMSB") == "True" else "<"
    data = pixels.astype(pixels.dtype.newbyteorder(order)).tobytes()
    data = zlib.compress(data) if packed else data
    head = {
        "ObjectType": "Image",
        "NDims": "3",
        "BinaryData": "True",
        "BinaryDataByteOrderMSB": "False",
        "CompressedData": str(packed),
        "DimSize": " ".join(map(str, pixels.shape[::-1])),
        "ElementSpacing": "1 1 1",
        "ElementType": TYPES[pixels.dtype.str[1:]],
        "Kinds": "domain domain list",
        "UltrasoundImageOrientation": orientation,
        "UltrasoundImageType": kind,
    } | ({"CompressedDataSize": str(len(data))} if packed else {})
    head |= changed
    lines = [f"{name} = {value}" for name, value in head.items() if value]
    lines += [f"Seq_Frame{n:04d}_{name} = {value}" for n, each in enumerate(frames) for name, value in each.items()]
    lines.append(f"ElementDataFile = {path.stem + '.raw' if separate else 'LOCAL'}\n")
    path.write_bytes("\n".join(lines).encode() + (b"" if separate else data))
    if separate:
        path.with_suffix(".raw").write_bytes(data)
    return path


def rf(frames=5, lines=12, samples=400):
    """Lines (frames, lines, samples) with one burst of known envelope in each frame, on an offset and some noise."""
    rng = np.random.default_rng(3)
    time = np.arange(samples)
    peaks = 1000.0 + 2000 * np.arange(frames)
    counts = rng.normal(40, 3, (frames, lines, samples))
    burst = np.exp(-(((time - 150) / 20) ** 2)) * np.cos(2 * np.pi * time / 8)
    for number, peak in enumerate(peaks):
        counts[number, number % lines] += peak * burst
    return np.rint(counts).astype(np.int16), peaks


@pytest.mark.parametrize("packed", [False, True])
def test_lines_of_radio_frequency_are_read_by_simpleitk_and_by_us_alike(tmp_path, packed):
    lines, peaks = rf()
    path = write_mha(tmp_path / "a.igs.mha", lines, fields(), packed=packed, **RF)
    np.testing.assert_array_equal(sitk.GetArrayFromImage(sitk.ReadImage(str(path))), lines)
    np.testing.assert_array_equal([frame.T for frame in open_sequence(path).frames()], lines)
    bank = read_bank(path)
    assert bank.angles_deg == TURNED
    np.testing.assert_allclose(bank.intensities, peaks, rtol=0.02)
    assert bank.started_s == pytest.approx([100, 100.5, 101, 101.5, 102])


def test_what_simpleitk_writes_is_read(tmp_path):
    lines, peaks = rf()
    image = sitk.GetImageFromArray(lines)
    for number, each in enumerate(fields()):
        for name, value in each.items():
            image.SetMetaData(f"Seq_Frame{number:04d}_{name}", value)
    image.SetMetaData("UltrasoundImageType", "RF_REAL")
    image.SetMetaData("UltrasoundImageOrientation", "FM")
    for name, packed in (("a.mha", False), ("b.mha", True), ("c.mhd", False), ("d.mhd", True)):
        sitk.WriteImage(image, str(tmp_path / name), useCompression=packed)
        bank = read_bank(tmp_path / name)
        assert bank.angles_deg == TURNED
        np.testing.assert_allclose(bank.intensities, peaks, rtol=0.02)


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
@pytest.mark.parametrize("detached", [False, True])
def test_a_nrrd_sequence_is_read_as_pynrrd_writes_it(tmp_path, encoding, detached):
    lines, peaks = rf()
    header = {"kinds": ["domain", "domain", "list"], "encoding": encoding, "UltrasoundImageType": "RF_REAL"}
    header |= {"UltrasoundImageOrientation": "FM"}
    header |= {f"Seq_Frame{n:04d}_{name}": value for n, each in enumerate(fields()) for name, value in each.items()}
    path = tmp_path / ("a.nhdr" if detached else "a.seq.nrrd")
    nrrd.write(str(path), np.transpose(lines), header, detached_header=detached)
    bank = read_bank(path)
    assert bank.angles_deg == TURNED
    np.testing.assert_allclose(bank.intensities, peaks, rtol=0.02)


def write_plus_nrrd(path, pixels, frames, **changed):
    """A NRRD of pixels (frames, rows, columns) with the names that PLUS itself writes, without any library."""
    head = {
        "type": {"u1": "uint8", "i2": "int16"}[pixels.dtype.str[1:]],
        "dimension": "3",
        "sizes": " ".join(map(str, pixels.shape[::-1])),
        "kinds": "domain domain list",
        "encoding": "raw",
        "endian": "little",
        "space dimension": "2",
        "space directions": "(0.3,0) (0,0.11) none",
        "space origin": "(0,0)",
    } | changed
    lines = ["NRRD0004", "# Complete NRRD file format specification at:"]
    lines += [f"{name}: {value}" for name, value in head.items() if not name.startswith("ultrasound")]
    lines += [f"{name}:={value}" for name, value in head.items() if name.startswith("ultrasound")]
    for number, each in enumerate(frames):
        names = {name: "Status" if name == "ImageStatus" else name for name in each}
        lines += [f"Seq_Frame{number:04d}_{names[name]}:={value}" for name, value in each.items()]
    path.write_bytes("\n".join([*lines, "", ""]).encode() + pixels.tobytes())
    return path


def test_the_names_of_a_nrrd_of_plus_are_read(tmp_path):
    """Its orientation, the size of its pixels, and the status of each image."""
    pixels = np.random.default_rng(2).integers(0, 255, (5, 20, 30), dtype=np.uint8)
    frames = fields(ImageStatus=["OK", "OK", "INVALID", "OK", "OK"])
    path = write_plus_nrrd(tmp_path / "a.igs.nrrd", pixels, frames, **{"ultrasound image orientation": "UNA"})
    with noted(r"1 of 5 frames are left out: Seq_Frame0002 \(ImageStatus INVALID\)"):
        series = read_image_sequence(path)
    np.testing.assert_array_equal(series.images, pixels[[0, 1, 3, 4], ::-1, ::-1])
    assert series.pixel_m == pytest.approx((0.11e-3, 0.3e-3))
    assert series.angles_deg == tuple(angle for angle in TURNED if angle != 0)


def test_lines_in_a_nrrd_of_plus_are_read(tmp_path):
    lines, peaks = rf()
    head = {"ultrasound image orientation": "FMA", "ultrasound image type": "RF_REAL"}
    np.testing.assert_allclose(
        read_bank(write_plus_nrrd(tmp_path / "a.igs.nrrd", lines, fields(), **head)).intensities, peaks, rtol=0.02
    )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"ultrasound image orientation": "LPS"},
            "UltrasoundImageOrientation is 'LPS', M or U across and F or N in depth",
        ),
        ({"ultrasound image type": "ELASTOGRAM"}, "UltrasoundImageType is 'ELASTOGRAM', it must be one of: RF_REAL"),
        ({"space units": '"cm" "cm"'}, 'its header has space units, \'"cm" "cm"\', and mm is expected'),
        ({"old max": "2047"}, "its header has old max, '2047', and only files without it are read"),
        ({"axis maxs": "9 9 NaN"}, "its header has axis maxs"),
    ],
)
def test_names_that_would_change_the_pixels_are_refused(tmp_path, changed, message):
    pixels = np.ones((5, 20, 30), np.uint8)
    with pytest.raises(RecordError, match=message):
        open_sequence(write_plus_nrrd(tmp_path / "a.igs.nrrd", pixels, fields(), **changed))


def test_a_slope_of_the_intensities_is_refused_unless_it_is_one(tmp_path):
    lines, _ = rf()
    path = write_mha(tmp_path / "a.mha", lines, fields(), ElementToIntensityFunctionSlope="1.0", **RF)
    assert open_sequence(path).kind == "RF_REAL"
    write_mha(path, lines, fields(), ElementToIntensityFunctionSlope="0.25", **RF)
    with pytest.raises(RecordError, match=r"ElementToIntensityFunctionSlope, '0\.25', and 1 is expected"):
        open_sequence(path)


def test_colours_and_a_third_domain_of_one_plane_are_read(tmp_path):
    rng = np.random.default_rng(1)
    pixels = rng.integers(0, 255, (5, 20, 30, 3), dtype=np.uint8)
    nrrd.write(
        str(tmp_path / "a.nrrd"),
        np.transpose(pixels),
        {"kinds": ["vector", "domain", "domain", "list"]}
        | {f"Seq_Frame{n:04d}_{name}": value for n, each in enumerate(fields()) for name, value in each.items()},
    )
    np.testing.assert_array_equal(read_image_sequence(tmp_path / "a.nrrd").images, pixels.max(axis=-1))
    path = write_mha(
        tmp_path / "a.mha", pixels[..., 0], fields(), NDims="4", DimSize="30 20 1 5", Kinds="domain domain domain list"
    )
    np.testing.assert_array_equal(read_image_sequence(path).images, pixels[..., 0])


@pytest.mark.parametrize(
    ("orientation", "turned"),
    [
        ("MFA", lambda frame: frame),
        ("UF", lambda frame: frame[:, ::-1]),
        ("MN", lambda frame: frame[::-1]),
        ("FM", lambda frame: frame.T),
        ("FU", lambda frame: frame[::-1].T),
        ("NM", lambda frame: frame[:, ::-1].T),
        ("XX", lambda frame: frame),
    ],
)
def test_images_have_depth_along_their_rows_whatever_their_orientation(tmp_path, orientation, turned):
    pixels = np.random.default_rng(1).integers(0, 255, (5, 20, 30), dtype=np.uint8)
    path = write_mha(tmp_path / "a.mha", pixels, fields(), orientation=orientation)
    for found, frame in zip(open_sequence(path).frames(), pixels, strict=True):
        np.testing.assert_array_equal(found, turned(frame))


def test_our_export_comes_back_with_its_angles_times_and_facts(tmp_path):
    write_sequence(tmp_path / "a.igs.mha", iter(images()), series=SERIES)
    bank = read_bank(tmp_path / "a.igs.mha")
    assert bank.angles_deg == ANGLES
    assert bank.intensities == pytest.approx([float(each.envelope.max()) for each in images()])
    assert bank.started_s == pytest.approx(TIMES)
    assert (bank.facts.description, bank.facts.reference_angle_deg) == (FACTS.description, FACTS.reference_angle_deg)
    turned = read_sequence(tmp_path / "a.igs.mha", angle_field="ProbeToProbeHome")
    assert turned.angles_deg == pytest.approx(ANGLES, abs=1e-9)
    sequence = open_sequence(tmp_path / "a.igs.mha")
    assert sequence.pixel_m == pytest.approx((0.25e-3, 1e-3))


@pytest.mark.parametrize(
    ("name", "axis", "sense"),
    [("ProbeToProbeHome", "y", 1), ("ProbeHomeToProbe", "y", -1), ("ProbeToStepperHome", "z", 1), ("AToB", "x", 1)],
)
def test_a_transform_gives_the_angle_about_its_axis_and_its_inverse_the_other_sign(tmp_path, name, axis, sense):
    frames = fields(
        **{f"{name}Transform": [matrix(sense * angle, axis) for angle in TURNED], f"{name}TransformStatus": ["OK"] * 5}
    )
    path = write_mha(tmp_path / "a.mha", rf()[0], frames, **RF)
    for given in (name, f"{name}Transform"):
        found = angles_of(open_sequence(path), angle_field=given)
        assert list(found.values()) == pytest.approx(TURNED, abs=1e-3)


def test_a_transform_into_another_frame_than_the_probes_at_rest_is_refused(tmp_path):
    moved = [Rotation.from_euler("xyz", (30, 20, angle), degrees=True).as_matrix() for angle in TURNED]
    texts = [" ".join(map(str, np.vstack([np.c_[each, np.zeros(3)], (0, 0, 0, 1)]).flat)) for each in moved]
    frames = fields(ProbeToTrackerTransform=texts, ProbeToTrackerTransformStatus=["OK"] * 5)
    path = write_mha(tmp_path / "a.mha", rf()[0], frames, **RF)
    with pytest.raises(RecordError, match=r"tilts the axis . by up to .* deg, at most 1 deg"):
        read_sequence(path, angle_field="ProbeToTracker")


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"ImageStatus": ["OK", "INVALID", "OK", "OK", "OK"]}, "Seq_Frame0001 (ImageStatus INVALID)"),
        (
            {"ProbeToStepperHomeTransformStatus": ["OK", "INVALID", "OK", "OK", "OK"]},
            "Seq_Frame0001 (ProbeToStepperHomeTransformStatus INVALID)",
        ),
        (
            {"ProbeToStepperHomeTransformStatus": ["OK", None, "OK", "OK", "OK"]},
            "Seq_Frame0001 (ProbeToStepperHomeTransformStatus missing)",
        ),
        (
            {"ProbeToStepperHomeTransformValid": ["1", "0", "true", "1", "1"]},
            "Seq_Frame0001 (ProbeToStepperHomeTransformStatus not valid: 0)",
        ),
        (
            {
                "ProbeToStepperHomeTransformStatus": [None] * 5,
                "ProbeToStepperHomeTransformValid": ["1", "false", "1", "1", "1"],
            },
            "Seq_Frame0001 (ProbeToStepperHomeTransformStatus not valid: false)",
        ),
        ({"ProbeRotation": ["-10", None, "0", "7.25", "20"]}, "Seq_Frame0001 (ProbeRotation missing)"),
        ({"ProbeRotation": ["-10", "NA", "0", "7.25", "20"]}, "Seq_Frame0001 (ProbeRotation NA)"),
    ],
)
def test_a_frame_without_a_valid_angle_or_image_is_left_out_and_named(tmp_path, changed, named):
    lines, peaks = rf()
    path = write_mha(tmp_path / "a.mha", lines, fields(**changed), **RF)
    with noted("1 of 5 frames are left out") as caught:
        bank = read_bank(path)
    assert named in caught[0]
    assert bank.angles_deg == (-10.0, 0.0, 7.25, 20.0)
    np.testing.assert_allclose(bank.intensities, np.delete(peaks, 1), rtol=0.02)
    assert bank.started_s == pytest.approx([100, 101, 101.5, 102])


def test_angles_in_any_order_and_repeated_ones_are_averaged_with_a_word(tmp_path):
    lines, peaks = rf()
    path = write_mha(tmp_path / "a.mha", lines, fields((5, -5, 0, 5, 9)), **RF)
    with noted("1 repeated angle"):
        bank = read_bank(path)
    assert bank.angles_deg == (-5, 0, 5, 9)
    np.testing.assert_allclose(bank.intensities, [peaks[1], peaks[2], (peaks[0] + peaks[3]) / 2, peaks[4]], rtol=0.02)
    assert bank.started_s == pytest.approx([100.5, 101, 100.75, 102])


@pytest.mark.parametrize("kind", ["RF_IQ_LINE", "RF_I_LINE_Q_LINE"])
def test_iq_data_are_read_by_their_envelope(tmp_path, kind):
    inphase, quadrature = np.zeros((2, 5, 6, 50), np.int16)
    inphase[:, 2, 20] = 3000
    quadrature[:, 2, 20] = 4000
    pixels = np.zeros((5, 6, 100), np.int16) if kind == "RF_IQ_LINE" else np.zeros((5, 12, 50), np.int16)
    places = np.s_[..., ::2], np.s_[..., 1::2]
    if kind == "RF_I_LINE_Q_LINE":
        places = np.s_[:, ::2], np.s_[:, 1::2]
    pixels[places[0]] = inphase
    pixels[places[1]] = quadrature
    path = write_mha(tmp_path / "a.mha", pixels, fields(), kind=kind, orientation="FM")
    assert read_bank(path).intensities == pytest.approx([5000] * 5)


def test_big_endian_and_separate_pixels_are_read(tmp_path):
    lines, peaks = rf()
    big = write_mha(tmp_path / "a.mha", lines, fields(), **RF, BinaryDataByteOrderMSB="True")
    apart = write_mha(tmp_path / "b.mhd", lines, fields(), **RF, separate=True)
    for path in (big, apart):
        np.testing.assert_allclose(read_bank(path).intensities, peaks, rtol=0.02)


def test_b_mode_is_for_the_tip_and_says_so(tmp_path):
    path = write_mha(tmp_path / "a.mha", np.zeros((5, 20, 30), np.uint8), fields())
    with pytest.raises(RecordError, match=r"5 B-mode images of 30 × 20 pixels: .*`sensitive_range\("):
        read_bank(path)
    lines = write_mha(tmp_path / "b.mha", rf()[0], fields(), **RF)
    with pytest.raises(RecordError, match="it holds RF_REAL and no B-mode images"):
        read_image_sequence(lines)


def test_the_size_of_a_pixel_is_that_of_the_spacing_where_it_is_one(tmp_path):
    pixels = np.zeros((5, 20, 30), np.uint8)
    sizes = {"1 1 1": None, "0.2 0.1 1": (1e-4, 2e-4)}
    for spacing, expected in sizes.items():
        path = write_mha(tmp_path / "a.mha", pixels, fields(), ElementSpacing=spacing)
        found = read_image_sequence(path).pixel_m
        assert found == (None if expected is None else pytest.approx(expected))


HOSTILE = {
    "ten terabytes": ({"DimSize": "1000000 1000000 5"}, "at most"),
    "more than the file": ({"DimSize": "400 12 500"}, "the file holds 48000; it is cut off"),
    "fewer than the file": ({"DimSize": "400 12 4"}, "it is cut off or damaged"),
    "negative": ({"DimSize": "400 -12 5"}, "expected: save it again"),
    "no size": ({"DimSize": ""}, "expected: save it again"),
    "two sizes": ({"DimSize": "400 12"}, "expected: save it again"),
    "no number": ({"DimSize": "400 zwölf 5"}, "expected: save it again"),
    "unknown type": ({"ElementType": "MET_SHRT"}, "expected: save it again"),
    "frames first": ({"Kinds": "list domain domain"}, "expected: save it again"),
    "text": ({"BinaryData": "False"}, "save it as binary"),
}


@pytest.mark.parametrize(("changed", "said"), HOSTILE.values(), ids=HOSTILE)
def test_a_header_that_does_not_fit_is_refused(tmp_path, changed, said):
    with pytest.raises(RecordError, match=said):
        read_bank(write_mha(tmp_path / "a.mha", rf()[0], fields(), **RF, **changed))


@pytest.mark.parametrize("place", ["../b.raw", "/etc/passwd", "LIST", "a%03d.raw/x"])
def test_pixels_elsewhere_are_not_read(tmp_path, place):
    path = write_mha(tmp_path / "a.mhd", rf()[0], fields(), **RF, separate=True)
    path.write_bytes(path.read_bytes().replace(b"= a.raw", f"= {place}".encode()))
    with pytest.raises(RecordError, match="keep them in one file beside it"):
        read_bank(path)


def test_a_file_that_is_cut_off_anywhere_is_refused(tmp_path):
    whole = write_mha(tmp_path / "a.mha", rf()[0], fields(), packed=True, **RF).read_bytes()
    head = whole.index(b"LOCAL")
    for length in (0, 1, 100, head, head + 3, head + 6, head + 100, len(whole) - 1000, len(whole) - 2):
        (tmp_path / "a.mha").write_bytes(whole[:length])
        with pytest.raises(RecordError, match=r"cut off|damaged|too early"):
            read_bank(tmp_path / "a.mha")


def test_pixels_that_unpack_to_more_than_was_said_are_refused(tmp_path):
    lines = np.zeros((5, 12, 400), np.int16)
    path = write_mha(tmp_path / "a.mha", lines, fields(), packed=True, **RF)
    bomb = zlib.compress(bytes(1 << 24), 9)
    start = path.read_bytes().index(b"LOCAL\n") + 6
    path.write_bytes(path.read_bytes()[:start] + bomb)
    with pytest.raises(RecordError, match="do not end where its header says"):
        read_bank(path)
    path.write_bytes(path.read_bytes()[:start] + gzip.compress(bytes(100)))
    with pytest.raises(RecordError, match=r"end too early|cannot be unpacked|bytes, and the file holds"):
        read_bank(path)


def test_where_no_frame_has_an_angle_or_rotation_it_is_refused(tmp_path):
    path = write_mha(tmp_path / "a.mha", rf()[0], fields(ProbeRotation=["x", "nan", "", "1 2", "inf"]), **RF)
    with (
        noted(r"5 of 5 frames are left out: Seq_Frame0000 \(ProbeRotation x\)"),
        pytest.raises(RecordError, match="no frame has a valid image and angle"),
    ):
        read_bank(path)
    mirrored = ["-1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"] * 5
    for wrong in (mirrored, [" ".join(["2"] * 16)] * 5):
        path = write_mha(tmp_path / "a.mha", rf()[0], fields(ProbeToStepperHomeTransform=wrong), **RF)
        with pytest.raises(RecordError, match="ProbeToStepperHomeTransform is no rotation in each frame"):
            read_sequence(path, angle_field="ProbeToStepperHome")


REAL = Path(__file__).parents[4] / "../shared/data/plus/USTC_3NWires_ProbeRotation.igs.mha"


@pytest.mark.skipif(not REAL.exists(), reason="the recording of PLUS is not here")
def test_a_recording_of_plus_is_read_as_its_header_has_it():
    image = sitk.ReadImage(str(REAL))
    sequence = open_sequence(REAL)
    np.testing.assert_array_equal(list(sequence.frames()), sitk.GetArrayFromImage(image))
    found = angles_of(sequence)
    assert found == {n: float(image.GetMetaData(f"Seq_Frame{n:04d}_ProbeRotation")) for n in range(142)}
    assert (min(found.values()), max(found.values())) == (-32.4464, 35.1502)
    turned = angles_of(sequence, angle_field="ProbeToStepperHome")
    assert list(turned.values()) == pytest.approx(list(found.values()), abs=1e-3)
    assert all(each["ProbeToStepperHomeTransformStatus"] == "OK" for each in sequence.frame_fields)
    times = [float(each["Timestamp"]) for each in sequence.frame_fields]
    assert times == [float(image.GetMetaData(f"Seq_Frame{n:04d}_Timestamp")) for n in range(142)]
    assert times == sorted(times)


def write_list_first(path, images, *, more=""):
    """A NRRD of images (frames, rows, columns) as 3D Slicer writes its sequences: the list is the fastest axis."""
    data = np.ascontiguousarray(images.transpose(1, 2, 0)).astype("<f4")
    head = {
        "type": "float", "dimension": "4", "sizes": f"{len(images)} {images.shape[2]} {images.shape[1]} 1",
        "kinds": "list domain domain domain", "spacings": "nan 0.2 0.3 1", "endian": "little", "encoding": "gzip",
    }  # fmt: skip
    lines = ["NRRD0005", *(f"{name}: {value}" for name, value in head.items()), "axis 0 index type:=numeric", "", ""]
    path.write_bytes("\n".join(lines).encode() + gzip.compress(data.tobytes()))
    return path


def test_a_sequence_with_its_list_first_takes_stated_angles(tmp_path):
    shown = np.random.default_rng(4).uniform(0, 100, (6, 7, 9)).astype(np.float32)
    path = write_list_first(tmp_path / "a.seq.nrrd", shown)
    values, header = nrrd.read(str(path))
    assert header["kinds"][0] == "list"
    np.testing.assert_array_equal(values[:, :, :, 0].transpose(0, 2, 1), shown)
    np.testing.assert_array_equal(list(open_sequence(path).frames()), shown)
    with pytest.raises(
        RecordError, match=r"its fields are none; .* `angle_field`, or state the angles: `first_and_step_deg"
    ):
        read_bank(path)
    bank = read_bank(path, TableFormat(first_and_step_deg=(10.0, -2.5)))
    assert bank.angles_deg == (-2.5, 0.0, 2.5, 5.0, 7.5, 10.0)
    np.testing.assert_allclose(bank.intensities, shown.max(axis=(1, 2))[::-1])
    with pytest.raises(RecordError, match="5 angles are given for 6 frames"):
        read_bank(path, TableFormat(angles_deg=(1.0, 2.0, 3.0, 4.0, 5.0)))


def test_a_frame_without_an_image_has_its_place_among_stated_angles(tmp_path):
    lines, peaks = rf()
    path = write_mha(tmp_path / "a.mha", lines, fields(ImageStatus=["OK", "INVALID", "OK", "OK", "OK"]), **RF)
    with notes_collected():
        bank = read_bank(path, TableFormat(first_and_step_deg=(0.0, 1.0)))
    assert "its ProbeRotation is not read" in bank.notes[0]
    assert "1 of 5 frames are left out" in bank.notes[1]
    assert bank.angles_deg == (0.0, 2.0, 3.0, 4.0)
    np.testing.assert_allclose(bank.intensities, np.delete(peaks, 1), rtol=0.02)
    with pytest.raises(ConfigError, match="both give the angles; leave one out"):
        read_bank(path, TableFormat(first_and_step_deg=(0.0, 1.0), angle_field="ProbeRotation"))


def test_the_way_back_of_a_stepper_with_a_backlash_is_left_out(tmp_path):
    angles = np.arange(-12.0, 12.5)
    heights = [300 + 9000 * np.exp(-0.5 * ((angles - at) / 2.2) ** 2) for at in (1.6, -0.4)]
    burst = np.cos(2 * np.pi * np.arange(60) / 8) * np.exp(-(((np.arange(60) - 30) / 9) ** 2))
    lines = np.rint(np.concatenate([heights[0], heights[1][::-1]])[:, None, None] * burst).astype(np.int16)
    there_and_back = np.concatenate([angles, angles[::-1]])
    path = write_mha(tmp_path / "a.mha", lines, fields(there_and_back), **RF)
    with noted(r"2\.00 deg below the pass of rising angles"):
        bank = read_bank(path)
    assert bank.angles_deg == tuple(angles.tolist())
    assert np.average(bank.angles_deg, weights=np.array(bank.intensities) ** 2) == pytest.approx(1.6, abs=0.2)


def test_a_field_has_the_unit_of_its_name(tmp_path):
    lines, _ = rf()
    path = write_mha(
        tmp_path / "a.mha", lines, fields(StageGon=["-10", "0", "5", "10", "20"], Steps=list("01234")), **RF
    )
    assert read_bank(path, TableFormat(angle_field="StageGon")).angles_deg == pytest.approx((-9, 0, 4.5, 9, 18))
    with pytest.raises(RecordError, match=r"'steps' is no unit of an angle; state the angles, `first_and_step_deg"):
        read_bank(path, TableFormat(angle_field="Steps"))
