"""Packages that are absent, and packages that are installed and cannot be imported."""

from __future__ import annotations

import importlib

import pytest

from markerseek.core import ConfigError, MissingExtraError, needs_package
from tests.broken_packages import BROKEN, break_package


@pytest.mark.parametrize("error", BROKEN.values(), ids=BROKEN)
def test_a_package_that_is_there_and_broken_is_not_called_missing(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    break_package(monkeypatch, "cv2", error)
    with (
        pytest.raises(ConfigError, match="installed and cannot be imported") as raised,
        needs_package("opencv-python-headless", extra="vision", purpose="a picture", module="cv2"),
    ):
        import cv2  # noqa: F401
    assert str(error) in str(raised.value)
    assert not isinstance(raised.value, MissingExtraError)


@pytest.mark.parametrize(("package", "module"), [("opencv-python-headless", "cv2"), ("pyserial", "serial")])
def test_a_package_that_is_absent_is_called_missing(package: str, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    break_package(monkeypatch, module, ModuleNotFoundError(f"No module named {module!r}", name=module))
    with (
        pytest.raises(MissingExtraError, match="which is not installed"),
        needs_package(package, extra="vision", purpose="a picture", module=module),
    ):
        importlib.import_module(f"{module}.tools")
