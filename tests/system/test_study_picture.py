"""``markerseek study`` with a picture."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from markerseek import cli

STUDY = """
version = 1
trials = 2
level = "frames"
drawn = "everything"
stay = true
marks = [2, 4]
[[policies]]
method = "golden-section"
acquisitions = 6
as_published = true
[rig]
start_deg = -35.0
"""


def shell(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    monkeypatch.setattr(sys, "argv", ["markerseek", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    code = ended.value.code
    return code if isinstance(code, int) else 0


def test_a_study_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    Path("one.toml").write_text(STUDY, encoding="utf-8")
    assert shell(monkeypatch, "study", "one.toml", "--workers", 1, "--plot") == 0
    assert "picture: out/one/error.png" in capsys.readouterr().out
    assert "<svg" in Path("out/one/error.svg").read_text(encoding="utf-8")[:500]
    assert Path("out/one/error.png").read_bytes().startswith(b"\x89PNG")
    assert shell(monkeypatch, "study", "one.toml", "--workers", 1, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    (policy,) = summary["policies"]
    assert policy["any_error_deg"]["count"] == 2
    assert len(policy["marks_deg"]) == 2
