"""``markerseek page``: serves the live page."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path
from typing import Annotated

import typer

from markerseek import rigs
from markerseek.bridges import page
from markerseek.cli.options import RigFile
from markerseek.cli.terminal import announce_compilation, stdout
from markerseek.core import ConfigError


def command(
    rig: RigFile = None,
    port: Annotated[int, typer.Option(help="Port; 0 takes any that is free.")] = 8765,
    host: Annotated[
        str, typer.Option(help="Address of this computer; one that other computers reach needs a certificate.")
    ] = "127.0.0.1",
    tls_certificate: Annotated[Path | None, typer.Option(help="Certificate for TLS (PEM).")] = None,
    tls_key: Annotated[Path | None, typer.Option(help="Key of the certificate (PEM).")] = None,
    public_url: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Address in the browser behind a tunnel (ssh -L, VS Code) or a proxy: http://localhost:9000, "
            "http://localhost:8888/proxy/8765/.",
        ),
    ] = None,
    cameras: Annotated[
        list[Path] | None,
        typer.Option(help="Calibration of the stereo endoscope beside a rig of devices, as of `markerseek register`."),
    ] = None,
    images: Annotated[
        str | None,
        typer.Option(metavar="'LEFT RIGHT'", help="Where its images come from, as of `markerseek register`."),
    ] = None,
    open_browser: Annotated[bool, typer.Option("--open", help="Open the page in a browser of this computer.")] = False,
) -> None:
    """Show a registration or a search live in the browser, and start and stop them there.

    The link holds a token: who has it can start searches. The page holds no device. It starts `markerseek register` and
    `markerseek search` as children, so that its results are those of the commands. A rig of devices is armed here in
    the terminal, never in the browser. What runs is stopped when this program ends, or when nobody has the page open: a
    search after 5 seconds, a session after 60. A session that was interrupted is offered when the page is started
    again with the same rig.

    Examples
    --------
    markerseek page
    markerseek page --rig examples/rigs/bench.toml
    """
    import webbrowser

    address = page.Address(host=host, port=port, certificate=tls_certificate, key=tls_key, public_url=public_url)
    if (cameras or images) and not (cameras and images and rig):
        raise ConfigError("--cameras and --images belong together, and to a rig of devices; name all three, or neither")
    shown = page.PageRig()
    if rig is not None:
        settings = rigs.read_rig_file(rig)
        shown = page.PageRig(file=rig, settings=settings, cameras=tuple(cameras or ()), images=images)
    browser = None
    if open_browser:
        try:
            browser = webbrowser.get()
        except webbrowser.Error as problem:
            raise ConfigError(
                "--open: no browser was found on this computer; leave it out and open the printed link"
            ) from problem
    searches = page.PageSearches(shown)

    def ready(link: str, once: str) -> None:
        stdout.print(f"open {link}", markup=False)
        stdout.print("[dim]Ctrl-C ends the page, and stops a search that runs[/]")
        if browser is not None:
            # In a thread: one that runs in the terminal ends only with its user, and the page is not yet served.
            # All users of the computer see the command of the browser, hence a link that works one time.
            threading.Thread(target=browser.open, args=(once,), daemon=True).start()

    announce_compilation()
    page.serve(searches, address, on_ready=ready)
    # Python would wait for threads that form images or draw a report, which nobody needs any more.
    sys.stdout.flush()
    os._exit(0)
