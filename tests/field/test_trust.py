"""Rig files from elsewhere whose drivers are modules beside them: nothing of them runs before a person trusts it."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek.core import ConfigError
from markerseek.rigs import bench, read_rig_file
from tests.emulated import markerseek

Shell = Callable[..., tuple[int, str, str]]

STAGE = """
from pathlib import Path
Path(__file__).with_name("it-ran").touch()
{imports}
class Stage:
    speed_deg_s = 1000.0
    def __init__(self):
        self.angle_deg = 0.0
    def read(self):
        from markerseek.drivers import StageStatus
        return StageStatus(angle_deg=self.angle_deg)
    def go(self, angle_deg):
        self.angle_deg = angle_deg
    def stop(self):
        pass
"""
RIG = """kind = "bench"
[stage]
driver = "{driver}:Stage"
[laser]
driver = "simulated"
[receiver]
driver = "simulated"
"""
SEARCH = ("--method", "ternary", "--acquisitions", "4", "--as-published", "--arm", "--no-journal")


class Lab:
    """A folder from elsewhere, with a rig file and a module beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.rig = folder, folder / "rig.toml"
        folder.mkdir()
        self.write()

    def write(self, driver: str = "evil", imports: str = "") -> None:
        file = self.folder / f"{driver.replace('.', '/')}.py"
        file.parent.mkdir(exist_ok=True)
        file.write_text(STAGE.format(imports=imports))
        self.rig.write_text(RIG.format(driver=driver))

    @property
    def has_run(self) -> bool:
        return any(self.folder.rglob("it-ran"))


@pytest.fixture
def lab(tmp_path: Path) -> Lab:
    return Lab(tmp_path / "lab")


ASKING = {
    "search": ("search",),
    "doctor": ("doctor",),
    "bank scan": ("bank", "scan", "scan.hdf5"),
    "page": ("page", "--port", "0"),
    "igtl": ("igtl", "--port", "0"),
    "stage node": ("ros2", "stage"),
    "search node": ("ros2", "search"),
}


@pytest.mark.parametrize("words", ASKING.values(), ids=ASKING)
def test_b7_nothing_of_a_foreign_driver_runs_before_a_person_says_so(
    lab: Lab, words: tuple[str, ...], shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(lab.folder)
    code, _, err = shell(*words, "--rig", lab.rig)
    assert (code, lab.has_run) == (4, False)
    assert f"{lab.folder}/evil.py would run as your own program" in err
    assert f"error: {lab.folder}/evil.py is not trusted, and nothing of it was run; read it, then add --trust" in err


WRONG = {
    "a simulation option": ("search", "--seed", "1"),
    "a method": ("search", "--method", "terrnary"),
    "two journals": ("search", "--journal", "x", "--no-journal"),
    "events": ("search", "--events", "x"),
    "compare": ("search", "--compare", "ternary,posterior"),
    "a wavelength": ("bank", "scan", "x.hdf5", "--wavelength-nm", "-1"),
    "emulate": ("emulate", "bench", "--dir", "x"),
    "sim node": ("ros2", "sim"),
}


@pytest.mark.parametrize("words", WRONG.values(), ids=WRONG)
def test_b7_a_wrong_option_or_a_command_for_simulated_rigs_is_refused_before_the_question(
    lab: Lab, words: tuple[str, ...], shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(lab.folder)
    code, _, err = shell(*words, "--rig", lab.rig)
    assert (code, lab.has_run, "would run as your own" in err) == (2, False, False)


def test_b7_trust_is_asked_for_once_and_again_after_a_change(lab: Lab, shell: Shell) -> None:
    lab.write(imports="from helper import x\nfrom tools import more")
    (lab.folder / "helper.py").write_text("x = 1\n")
    (lab.folder / "tools").mkdir()
    for name in ("__init__", "more", "unused"):
        (lab.folder / "tools" / f"{name}.py").write_text("\n")
    search = ("search", "--rig", lab.rig, *SEARCH, "--json")
    code, out, err = shell(*search)
    assert (code, json.loads(out)["kind"]) == (4, "UntrustedError")
    beside = ", ".join(f"{lab.folder}/{each}" for each in ("helper.py", "tools/__init__.py", "tools/more.py"))
    assert f"it imports beside it: {beside}\n" in err
    code, _, err = shell(*search, "--trust")
    assert (code, "would run" in err) == (0, True)
    assert lab.has_run
    for unchanged in (lambda: None, lambda: (lab.folder / "tools" / "unused.py").write_text("y = 1\n")):
        unchanged()
        code, _, err = shell(*search)
        assert (code, "would run" in err) == (0, False)
    for changed in (lab.folder / "evil.py", lab.folder / "helper.py", lab.folder / "tools" / "more.py"):
        changed.write_text(changed.read_text() + "# changed\n")
        assert shell(*search)[0] == 4
        assert shell(*search, "--trust")[0] == 0
    # The same text is trusted wherever it lies.
    other = Lab(lab.folder.parent / "other")
    other.write(imports="from helper import x\nfrom tools import more")
    assert shell("search", "--rig", other.rig, *SEARCH)[0] == 4


@pytest.mark.parametrize("driver", ["../outside", "outside.py", ".outside", "out/side"])
def test_b7_a_driver_that_is_no_module_is_refused_before_the_question(lab: Lab, driver: str, shell: Shell) -> None:
    for folder in (lab.folder, lab.folder.parent):
        (folder / "outside.py").write_text(STAGE.format(imports=""))
    lab.rig.write_text(RIG.format(driver=driver))
    code, _, err = shell("search", "--rig", lab.rig, *SEARCH)
    assert (code, lab.has_run, "would run as your own" in err) == (2, False, False)
    assert 'it must be "module:Class"' in err


@pytest.mark.parametrize("imports", ["from ..outside import x", "from .............. import x", "def ("])
def test_b7_what_a_module_cannot_import_is_no_defect(lab: Lab, imports: str, shell: Shell) -> None:
    (lab.folder.parent / "outside.py").write_text("x = 1\n")
    lab.write(imports=imports)
    assert shell("search", "--rig", lab.rig, *SEARCH)[0] == 4
    code, _, err = shell("search", "--rig", lab.rig, *SEARCH, "--trust")
    assert (code, "importing evil failed: " in err) == (2, True)


def test_b7_a_package_beside_the_rig_file_is_asked_for_too(lab: Lab, shell: Shell) -> None:
    lab.write("bare.evil")
    code, _, err = shell("search", "--rig", lab.rig, *SEARCH)
    assert (code, lab.has_run) == (4, False)
    assert f"{lab.folder}/bare/evil.py is not trusted" in err
    assert shell("search", "--rig", lab.rig, *SEARCH, "--trust")[0] == 0


def test_b7_what_is_compiled_beside_is_not_run_in_the_place_of_the_text(lab: Lab, shell: Shell) -> None:
    import importlib.util
    import py_compile

    text = (lab.folder / "evil.py").read_text()
    (lab.folder / "evil.py").write_text("raise SystemExit('the cache was run')\n")
    # Of this kind Python never looks at the text.
    py_compile.compile(
        str(lab.folder / "evil.py"),
        cfile=importlib.util.cache_from_source(str(lab.folder / "evil.py")),
        invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH,
    )
    (lab.folder / "evil.py").write_text(text)
    assert shell("search", "--rig", lab.rig, *SEARCH, "--trust")[0] == 0


def test_b7_an_installed_driver_needs_no_question_and_gets_nothing_from_beside(
    lab: Lab, shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    site = tmp_path / "site"
    (site / "vendor_of_stages").mkdir(parents=True)
    (site / "vendor_of_stages" / "__init__.py").write_text(STAGE.format(imports=""))
    monkeypatch.syspath_prepend(site)
    lab.rig.write_text(RIG.format(driver="vendor_of_stages"))
    code, _, err = shell("search", "--rig", lab.rig, *SEARCH)
    assert (code, "would run" in err) == (0, False)
    assert str(lab.folder) not in sys.path
    # A file beside the rig file goes before what is installed, and so it is asked for.
    lab.write("vendor_of_stages")
    assert shell("search", "--rig", lab.rig, *SEARCH)[0] == 4


def test_b7_python_imports_nothing_that_is_not_trusted_either(lab: Lab) -> None:
    settings = read_rig_file(lab.rig)
    with pytest.raises(ConfigError, match=r"evil\.py comes with the rig file and is not trusted yet"):
        bench(settings)
    assert not lab.has_run
    for module in settings.modules_beside.values():
        module.trust()
    with bench(settings) as rig:
        assert rig.scanner.angle_deg == 0.0


def test_b7_a_file_name_typed_on_the_terminal_is_a_yes(lab: Lab) -> None:
    for typed, code in ((b"yes\n", 4), (b"evil.py\n", 0)):
        ours, theirs = os.openpty()
        command = markerseek("search", "--rig", lab.rig, *SEARCH)
        process = subprocess.Popen(command, stdin=theirs, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        os.close(theirs)
        said = b""
        # The question may be wrapped anywhere.
        while b"nameofthefile:" not in b"".join(said.split()):
            piece = process.stderr.read(1)
            assert piece, said
            said += piece
        assert not lab.has_run
        os.write(ours, typed)
        process.communicate()
        os.close(ours)
        assert process.returncode == code
    assert lab.has_run


def test_b7_a_user_who_can_remember_nothing_is_told_what_to_set(
    lab: Lab, shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "file"))
    code, _, err = shell("search", "--rig", lab.rig, *SEARCH, "--trust")
    assert (code, lab.has_run) == (2, False)
    assert "what is trusted cannot be remembered (Not a directory); set XDG_DATA_HOME" in err
