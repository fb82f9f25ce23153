"""Makes a release into out/release: `make release VERSION=0.2.0`.

It sets the version, joins the files of changelog.d into the changelog, runs the checks, makes wheel, source
distribution, bill of materials, notes and checksums, and commits and tags what has changed. Nothing leaves this
computer. If a step fails, the changed files are as they were.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import shutil
import subprocess
import sys
from pathlib import Path

from packaging.version import InvalidVersion, Version

ROOT = Path(__file__).parents[1]
VERSION_FILE, CHANGELOG = ROOT / "src" / "markerseek" / "_version.py", ROOT / "CHANGELOG.md"
CHANGES = ROOT / "changelog.d"
MADE, OUT = ROOT / "out" / "dist", ROOT / "out" / "release"
SUMS = "SHA256SUMS"


def main() -> None:
    """Make the release, or say what is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("version", help="such as 0.2.0")
    parser.add_argument(
        "--checks", default="check test-long docs wheel", help="targets of make that must succeed; wheel last"
    )
    asked = parser.parse_args()
    version = require_release(asked.version)
    before = {path: path.read_bytes() for path in (VERSION_FILE, CHANGELOG, *require_changes())}
    try:
        set_version(version)
        notes = join_changes(version)
        for target in asked.checks.split():
            run("make", target)
        collect(version, notes)
        run("git", "commit", "--quiet", "--message", f"Release {version}", *map(str, before))
    except BaseException:
        for path, text in before.items():
            path.write_bytes(text)
        raise
    # The sums stand in the tag, so that whoever has a wheel can compare it without its folder.
    message = f"markerseek {version}\n\n{(OUT / SUMS).read_text(encoding='utf-8')}"
    run("git", "tag", "--annotate", "--message", message, f"v{version}")
    sys.stdout.write(f"{OUT}: markerseek {version}, committed and tagged v{version}; nothing was sent anywhere\n")


def run(*words: str) -> str:
    """Run a program in the checkout, and end with its exit code if it fails."""
    done = subprocess.run(
        words, cwd=ROOT, check=False, stdout=subprocess.PIPE if words[0] == "git" else None, text=True
    )
    if done.returncode:
        sys.exit(f"release: {' '.join(words)} ended with {done.returncode}; nothing is released")
    return done.stdout or ""


def require_release(text: str) -> Version:
    """The version, if it can follow the present one and the checkout is as it was committed."""
    now = Version(re.search(r'^__version__ = "(.+)"$', VERSION_FILE.read_text(encoding="utf-8"), re.M)[1])
    try:
        version = Version(text)
    except InvalidVersion:
        sys.exit(f"release: {text!r} is no version; write it as 0.2.0")
    if not version > now:
        sys.exit(f"release: {version} does not follow {now}; choose a greater one")
    if run("git", "tag", "--list", f"v{version}"):
        sys.exit(f"release: there is a tag v{version} already; choose a greater version")
    if run("git", "status", "--porcelain"):
        sys.exit("release: the checkout has changes that are not committed; commit or remove them")
    return version


def require_changes() -> list[Path]:
    """The files of changelog.d, if there are any."""
    changes = sorted(path for path in CHANGES.glob("*.md") if path.name != "README.md")
    if not changes:
        sys.exit("release: changelog.d has no file; write down what has changed, as its README.md says")
    return changes


def set_version(version: Version) -> None:
    """Write the version where it is kept."""
    text = VERSION_FILE.read_text(encoding="utf-8")
    text = re.sub(r'^__version__ = ".+"$', f'__version__ = "{version}"', text, flags=re.M)
    VERSION_FILE.write_text(text, encoding="utf-8")


def join_changes(version: Version) -> str:
    """Join the files of changelog.d into the changelog, and return its new section."""
    run(sys.executable, "-m", "scriv", "collect", "--version", str(version))
    return section_of(version, CHANGELOG.read_text(encoding="utf-8"))


def section_of(version: Version, changelog: str) -> str:
    """What the changelog says of a release."""
    heading = rf"^## {re.escape(str(version))} \([\d-]+\)\n"
    section = re.search(heading + r"(.*?)(?=^<a id|^## |\Z)", changelog, re.M | re.S)
    if section is None or not section[1].strip():
        sys.exit(f"release: CHANGELOG.md has no section of {version} after its files were joined")
    return section[1].strip()


def collect(version: Version, notes: str) -> None:
    """Put what is released into one folder, with checksums."""
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    for path in (*MADE.glob(f"markerseek-{version}-*.whl"), *MADE.glob(f"markerseek-{version}.tar.gz")):
        shutil.copy2(path, OUT)
    if len(list(OUT.iterdir())) != 2:
        sys.exit(f"release: {MADE} has no wheel and sdist of {version}; let make wheel or make dist be the last check")
    bill = OUT / f"markerseek-{version}.cdx.json"
    run(
        sys.executable,
        "-m",
        "cyclonedx_py",
        "requirements",
        "requirements/run.txt",
        "--pyproject",
        "pyproject.toml",
        "--output-reproducible",
        "--output-file",
        str(bill),
    )
    (OUT / "NOTES.md").write_text(f"# markerseek {version}\n\n{notes}\n", encoding="utf-8")
    sums = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}" for path in sorted(OUT.iterdir())]
    (OUT / SUMS).write_text("\n".join(sums) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
