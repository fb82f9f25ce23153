"""The registration of a run that follows: whether it holds with the devices as they are; that a spot confirms it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.markup import escape

from markerseek import following, registration, rigs
from markerseek.cli.terminal import stderr
from markerseek.core import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedRegistration:
    """The registration that a person names."""

    path: Path
    known: registration.KnownRegistration
    session: Path | None
    """Folder of its session; None of a file without one."""
    devices: following.DevicesSeen | None
    """Those of the session, or of the last spot that has confirmed it; None: nobody kept them."""


def named_registration(path: Path) -> NamedRegistration:
    """Return the registration at a path; `ConfigError` if none holds."""
    folder = registration.session_folder(path)
    if folder is None:
        known = registration.read_registration(path)
        return NamedRegistration(path=path, known=known, session=None, devices=None)
    view = registration.read_view(folder)
    if view.registration is None:
        raise ConfigError(f"{folder}: no registration holds: {view.reason}")
    begun = None if view.begun is None else following.DevicesSeen.of_session(view.begun)
    devices = following.read_confirmed(folder) or begun
    return NamedRegistration(path=path, known=view.registration, session=folder, devices=devices)


@contextmanager
def held_registration(
    named: NamedRegistration, rig: rigs.Rig, *, stereo: registration.StereoSettings | None, lit: bool, still_valid: bool
) -> Iterator[following.HeldRegistration]:
    """Hold a registration as far as the devices are as they were, and note in the end that a spot has confirmed it.

    ``stereo``: None: no cameras are named. ``lit``: whether a spot is followed. ``still_valid``: whether a person says
    that nothing was off, nor moved. Raises `ConfigError` where the devices have changed, and no spot is followed.
    """
    devices = following.DevicesSeen(
        rig=rig.facts.fingerprint,
        description=rig.facts.description,
        cameras=None if stereo is None else registration.camera_text(stereo),
        stage_since=rig.stage_since,
    )
    changed = () if named.devices is None else devices.changes_since(named.devices)
    if changed:
        doubt = f"{named.path} does not hold until a spot has confirmed it: {'; '.join(changed)}"
        if not lit:
            raise ConfigError(f"{doubt}; follow a laser spot first, by --spot, or register again")
        stderr.print(f"[yellow]{escape(doubt)}[/]")
    held = following.HeldRegistration(named.known, confirmed=still_valid and not changed)
    by_spot = not held.confirmed
    try:
        yield held
    finally:
        if by_spot and held.confirmed and named.session is not None:
            try:
                following.write_confirmed(named.session, devices)
            except OSError as problem:
                stderr.print(escape(f"{named.session}: that a spot has confirmed it could not be noted: {problem}"))


def say_errors(known: registration.KnownRegistration, links: following.ErrorLinks) -> None:
    """Print which errors are in the uncertainty of the target, and which are not."""
    counted = "; ".join([f"the registration, {1e3 * known.report.tre_m:.2f} mm", *links.counted])
    stderr.print(f"[dim]{escape(f'in the error of the target: {counted}')}[/]")
    if links.not_counted:
        said = f"NOT in it: {'; '.join(links.not_counted)}; state what is known of it by --tip-sigma-mm"
        stderr.print(f"[yellow]{escape(said)}[/]")
