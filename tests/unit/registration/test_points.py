"""Tables of points of a registration."""

from __future__ import annotations

from pathlib import Path

import pytest

from markerseek.core import RecordError


@pytest.mark.parametrize("comma", [True, False])
def test_points_of_a_registration_are_read_in_their_notation(tmp_path: Path, comma: bool) -> None:
    from markerseek.registration.points import point_pairs

    names = "name;trus_x_m;trus_y_m;trus_z_m;camera_x_m;camera_y_m;camera_z_m"
    rows = ["a;0,075933;−0,025899;0,061;1.055e-2;0.5;1.055", "b;0,5;−0,1;0,06;0.01;0.5;0.7"]
    text = "\n".join([names, *rows])
    path = tmp_path / "points.csv"
    path.write_text(text.replace(".", ",") if comma else text.replace(",", "."), encoding="utf-8")
    first = point_pairs(path)[0]
    assert first.trus_m.tolist() == [0.075933, -0.025899, 0.061]
    assert first.camera_m.tolist() == [0.01055, 0.5, 1.055]
    path.write_text("trus_x_m,trus_y_m,trus_z_m,camera_x_m,camera_y_m,camera_z_m\n0,1,0,2,0,3,0,4,0,5,0,6\n")
    with pytest.raises(RecordError, match="line 2: it has 12 columns, 6 are named; a number with a decimal comma"):
        point_pairs(path)
