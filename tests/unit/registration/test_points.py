"""Camera images of a registration that cannot be used are named."""

from __future__ import annotations

import numpy as np
import pytest

from markerseek.core import RecordError
from markerseek.registration.points import read_camera_images


@pytest.mark.parametrize(
    ("pixels", "says"),
    [(None, "it is cut off, or no PNG"), (np.zeros((130, 130), np.uint16), "pixels of uint16, they must have 8 bits")],
)
def test_an_image_that_cannot_be_read_is_named(tmp_path, pixels, says):
    cv2 = pytest.importorskip("cv2")
    data = b"no image" if pixels is None else cv2.imencode(".png", pixels)[1].tobytes()
    (tmp_path / "0.png").write_bytes(data)
    with pytest.raises(RecordError, match=rf"0\.png: .*{says}"):
        read_camera_images(tmp_path)
