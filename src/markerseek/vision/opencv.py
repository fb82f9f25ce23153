"""OpenCV, imported when it is first needed: the only file that names it."""

from __future__ import annotations

from types import ModuleType

from markerseek.core import MissingExtraError


def opencv(purpose: str) -> ModuleType:
    """The package ``cv2``.

    Parameters
    ----------
    purpose
        What it is needed for, for the message.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        import cv2
    except ImportError as problem:
        raise MissingExtraError(package="opencv-python-headless", extra="vision", purpose=purpose) from problem
    return cv2
