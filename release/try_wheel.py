"""Installs the wheel alone, outside of the checkout, and uses it as a stranger would: `make wheel`.

For each Python: the commands without extras work or name the extra that is missing, and no test tool came with it. On
the first Python also each extra. A Python that this computer does not have is printed as not tried. ``python
release/try_wheel.py out/dist 3.12`` tries one.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
TOOLS = {"pytest", "pytest-cov", "coverage", "hypothesis", "sphinx", "mypy", "ruff", "pymust", "beartype"}
NOT_IN_SDIST = (".ci/", ".github/", ".gitignore")

LIMIT_S = 300.0
"""Seconds within which a command ends, the compilation of the kernels included."""

WITHOUT = {
    "plot": ("search", "--seed", "1", "--plot", "--no-journal"),
    "records": ("bank", "scan", "scan.hdf5"),
    "devices": ("search", "--rig", str(ROOT / "examples" / "rigs" / "bench.toml"), "--arm", "--no-journal"),
    "page": ("page",),
    "igtl": ("igtl",),
    "vision": ("tooltip", "images"),
    "ros2": ("ros2", "search"),
}
"""A command that needs each extra."""

WITH = {
    "plot": ("search", "--seed", "1", "--plot", "--no-journal"),
    "records": ("bank", "scan", "scan.hdf5", "--step-deg", "5"),
    "devices": ("emulate", "bench", "--help"),
    "page": ("page", "--help"),
    "igtl": ("igtl", "--help"),
    "vision": ("tooltip", "--help"),
}
"""The same, or its help where it would not end, once they are installed; they are installed together."""

RESOLVED = ("notebook", "ros2", "standa")
"""Extras that are resolved and not installed: they are large."""


def interpreter(version: str) -> Path | None:
    """A Python of this version, of the system or of pyenv, that runs."""
    found = [*Path("/usr/bin").glob(f"python{version}"), *Path("/usr/local/bin").glob(f"python{version}")]
    found += Path.home().glob(f".pyenv/versions/{version}.*/bin/python{version}")
    for path in found:
        if subprocess.run([path, "-c", "import ensurepip, venv"], capture_output=True, check=False).returncode == 0:
            return path
    return None


class Environment:
    """A virtual environment with the wheel, in a folder of its own, in which commands run as a stranger's would."""

    def __init__(self, folder: Path, python: Path, wheel: Path) -> None:
        self._folder, self._wheel = folder, wheel
        subprocess.run([python, "-m", "venv", folder], check=True)
        (folder / "images").mkdir()
        for number in range(2):
            (folder / "images" / f"{number}.png").write_bytes(b"\x89PNG\r\n\x1a\n")

    def pip(self, *words: str) -> str:
        """What pip prints; it ends the program if it fails."""
        command = [self._folder / "bin" / "python", "-m", "pip", "--disable-pip-version-check", *words]
        return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout

    def install(self, *extras: str, dry: bool = False) -> set[str]:
        """Install the wheel with these extras; the names of what came or would come."""
        wheel = f"{self._wheel}[{','.join(extras)}]" if extras else str(self._wheel)
        how = ("--dry-run",) if dry else ()
        report = json.loads(self.pip("install", "-qq", "--report", "-", *how, wheel))
        return {each["metadata"]["name"].lower() for each in report["install"]}

    def command(self, *words: str) -> tuple[int, str]:
        """Exit code and all that a command prints; away from the checkout, and with a home of its own."""
        environment = {
            "PATH": f"{self._folder / 'bin'}:{os.environ['PATH']}",
            "HOME": str(self._folder),
            "COLUMNS": "200",
        }
        try:
            done = subprocess.run(
                [self._folder / "bin" / "markerseek", *words],
                cwd=self._folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                check=False,
                timeout=LIMIT_S,
            )
        except subprocess.TimeoutExpired:
            return -1, f"it has not ended in {LIMIT_S:g} s"
        return done.returncode, done.stdout + done.stderr


def complaints(environment: Environment, *, extras: bool) -> list[str]:
    """What does not work in an environment."""
    found = [f"the wheel alone brings {name}" for name in environment.install() & TOOLS]
    code, printed = environment.command("search", "--seed", "1", "--json", "--no-journal")
    if code or not json.loads(printed)["found"]:
        found.append(f"search ended with {code}: {printed}")
    for extra, words in WITHOUT.items():
        code, printed = environment.command(*words)
        if code != 2 or f"FILE.whl[{extra}]" not in printed:
            found.append(f"{' '.join(words)} without the extra {extra} ended with {code}: {printed[-400:]}")
    if extras:
        found += [
            f"{tool} comes with an extra" for extra in RESOLVED for tool in environment.install(extra, dry=True) & TOOLS
        ]
        found += [f"{tool} comes with an extra" for tool in environment.install(*WITH) & TOOLS]
        for extra, words in WITH.items():
            code, printed = environment.command(*words)
            if code:
                found.append(f"{' '.join(words)} with the extra {extra} ended with {code}: {printed[-400:]}")
    return found


def left_out(sdist: Path) -> list[str]:
    """Files of the checkout that the source distribution does not hold.

    A release has joined the files of changelog.d and removed them, which is committed at its end only.
    """
    with tarfile.open(sdist) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    done = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    here = [name for name in done.stdout.splitlines() if (ROOT / name).exists()]
    return [name for name in here if name not in held and not name.startswith(NOT_IN_SDIST)]


def main() -> None:
    """Try the wheel and the source distribution in a folder; exit code 1 if something does not work."""
    folder, versions = Path(sys.argv[1]).resolve(), sys.argv[2:] or PYTHONS
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    found = [f"{sdist.name} lacks {name}" for name in left_out(sdist)]
    tried = 0
    for version in versions:
        python = interpreter(version)
        if python is None:
            sys.stdout.write(f"Python {version}: not tried, there is none on this computer\n")
            continue
        with tempfile.TemporaryDirectory(prefix="wheel ") as place:
            wrong = complaints(Environment(Path(place), python, wheel), extras=not tried)
        tried += 1
        sys.stdout.write(f"Python {version}: {'; '.join(wrong) or 'works'}\n")
        sys.stdout.flush()
        found += wrong
    sys.exit("\n".join(found) or (0 if tried else "no Python to try the wheel with"))


if __name__ == "__main__":
    main()
