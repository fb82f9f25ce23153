"""TOML that would take the parser minutes or gigabytes is refused before it is parsed."""

from __future__ import annotations

from pathlib import Path

import pytest

from markerseek.core import ConfigError
from markerseek.files import read_toml


@pytest.mark.parametrize(
    "text",
    [
        "stage" + ".x" * 9000 + " = 1",
        '"stage"' + ' . "two words"' * 9000 + " = 1",
        "[" + "'a'.b." * 5000 + "c]",
        "[[" + "a." * 5000 + "c]]",
        "limits = { " + "a." * 5000 + "c = 1 }",
    ],
)
def test_a_key_of_very_many_parts_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"rig\.toml: the rig file has a key of more than 32 parts, two or three are"):
        read_toml(path, what="rig file")


def test_numbers_texts_and_comments_with_many_dots_are_no_keys(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    numbers = [0.5 * each for each in range(60)]
    path.write_text(f"# {'. ' * 90}\na.b.c = {numbers}\ntext = '{'…. ' * 90}'\n", encoding="utf-8")
    assert read_toml(path, what="rig file")["a"] == {"b": {"c": numbers}}
