"""``markerseek page``: serves the live page."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path
from typing import Annotated

import typer

from markerseek.bridges import page
from markerseek.cli.open_rig import read_rig
from markerseek.cli.options import RigFile, Trust
from markerseek.cli.terminal import announce_compilation, stdout
from markerseek.core import ConfigError
from markerseek.files import quoted

EXAMPLES = """
    markerseek page
    markerseek page --rig examples/rigs/bench.toml
    markerseek page run.journal scan.hdf5
"""


def command(
    recordings: Annotated[
        list[Path] | None, typer.Argument(help="Journals and banks that can be replayed on the page.")
    ] = None,
    rig: RigFile = None,
    trust: Trust = False,
    port: Annotated[int, typer.Option(help="Port; 0 takes any that is free.")] = 8765,
    host: Annotated[
        str, typer.Option(help="Address of this computer; one that other computers reach needs a certificate.")
    ] = "127.0.0.1",
    tls_certificate: Annotated[Path | None, typer.Option(help="Certificate for TLS (PEM).")] = None,
    tls_key: Annotated[Path | None, typer.Option(help="Key of the certificate (PEM).")] = None,
    public_url: Annotated[
        str | None,
        typer.Option(
            metavar="URL", help="Address in the browser behind a tunnel (ssh -L, VS Code): http://localhost:9000."
        ),
    ] = None,
    open_browser: Annotated[bool, typer.Option("--open", help="Open the page in a browser of this computer.")] = False,
) -> None:
    """Show a search live in the browser, and start, stop and replay searches there.

    The link holds a token: who has it can start searches. The page holds no device. It starts `markerseek search` as a
    child, so that its results are those of the command. A rig of devices is armed here in the terminal, never in the
    browser. When this program ends, or nobody has the page open for 5 seconds, a search that runs is stopped.
    """
    import webbrowser

    address = page.Address(host=host, port=port, certificate=tls_certificate, key=tls_key, public_url=public_url)
    shown = page.PageRig() if rig is None else page.PageRig(file=rig, settings=read_rig(rig, trust=trust))
    for path in recordings or []:
        if not path.exists():
            raise ConfigError(f"{quoted(path)}: there is no such file; name journals or banks that exist")
    browser = None
    if open_browser:
        try:
            browser = webbrowser.get()
        except webbrowser.Error as problem:
            raise ConfigError(
                "--open: no browser was found on this computer; leave it out and open the printed link"
            ) from problem
    launcher = page.Launcher()
    searches = page.PageSearches(launcher, shown, recordings or [])

    def ready(link: str) -> None:
        launcher.lower_others()
        stdout.print(f"open {link}", markup=False)
        stdout.print("[dim]Ctrl-C ends the page, and stops a search that runs[/]")
        if browser is not None:
            # In a thread: one that runs in the terminal ends only with its user, and the page is not yet served.
            # Without the token: the command of the browser is seen by all users of the computer.
            threading.Thread(target=browser.open, args=(link.partition("?")[0],), daemon=True).start()

    announce_compilation()
    page.serve(searches, address, on_ready=ready, opened=open_browser)
    # Python would wait for threads that form images or draw a report, which nobody needs any more.
    sys.stdout.flush()
    os._exit(0)
