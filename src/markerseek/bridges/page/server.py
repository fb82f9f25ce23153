"""Serves the page: address, token, certificate, and the end of all searches with the program."""

from __future__ import annotations

import asyncio
import errno
import secrets
import socket
import ssl
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.security import BODY_BYTES, TOKEN_PARAMETER, Access, SecurityLayer
from markerseek.core import ConfigError, needs_package

LOOPBACK = "127.0.0.1"
"""Address that only programs on this computer reach."""

_LOOPBACK_NAMES = frozenset({LOOPBACK, "localhost"})

USUAL_PORT = 8765
"""Port where none is named."""

UNWATCHED_S = 5.0
"""Time without any viewer after which a search is stopped, in seconds: nobody would see it, or press STOP."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Address:
    """Where the page is served.

    Attributes
    ----------
    host, port
        Address and port of this computer; port 0 takes any that is free.
    certificate, key
        PEM files for TLS; needed for any other address than `LOOPBACK`.

    Raises
    ------
    ConfigError
        If the port is out of range, or an address that others reach has no certificate.
    """

    host: str = LOOPBACK
    port: int = USUAL_PORT
    certificate: Path | None = None
    key: Path | None = None

    def __post_init__(self) -> None:
        if self.host in {"", "0.0.0.0"}:  # noqa: S104  refused
            raise ConfigError(
                f"host is {self.host!r}: name the one address of this computer that others open, such as 192.168.1.5"
            )
        if self.host != self.host.lower():
            raise ConfigError(f"host is {self.host}: browsers send names in small letters; write {self.host.lower()}")
        if not 0 <= self.port <= 65535:
            raise ConfigError(f"port is {self.port}, it must lie between 0 and 65535; {USUAL_PORT} is usual")
        if (self.certificate is None) != (self.key is None):
            raise ConfigError("TLS needs both a certificate and its key; name both, or neither")
        if self.host not in _LOOPBACK_NAMES and self.certificate is None:
            raise ConfigError(
                f"host is {self.host}: other computers reach it, which needs TLS; name --tls-certificate "
                f"and --tls-key, or leave the host out for {LOOPBACK}"
            )
        if self.certificate is not None and self.key is not None:
            try:
                ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(self.certificate, self.key)
            except (OSError, ssl.SSLError) as problem:
                raise ConfigError(
                    f"{self.certificate}, {self.key}: no certificate with its key: {problem}"
                ) from problem

    @property
    def scheme(self) -> str:
        """``https`` with a certificate, else ``http``."""
        return "http" if self.certificate is None else "https"

    def listening(self) -> socket.socket:
        """A socket that listens there.

        Raises
        ------
        ConfigError
            If the port is taken, or the address is not one of this computer.
        """
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        # A page that was just closed leaves its port for a minute otherwise.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((self.host, self.port))
            listener.listen(64)
        except OSError as problem:
            listener.close()
            # An address of another computer, or a name that nobody knows, is no better on another port.
            foreign = isinstance(problem, socket.gaierror) or problem.errno == errno.EADDRNOTAVAIL
            raise ConfigError(
                f"{self.host}:{self.port}: the page cannot be served there: {problem.strerror}; "
                + ("name an IPv4 address of this computer as --host" if foreign else "name another --port")
            ) from problem
        return listener


def serve(searches: PageSearches, address: Address, *, on_ready: Callable[[str], None]) -> None:
    """Serve the page until SIGINT or SIGTERM; searches that run then are stopped.

    Parameters
    ----------
    searches
        The searches of the page.
    address
        Where.
    on_ready
        Called with the link, which holds a new token, once the port is open.

    Raises
    ------
    MissingExtraError
        If NiceGUI is not installed.
    ConfigError
        If the page cannot be served there.
    """
    with needs_package("nicegui", extra="page", purpose="the live page"):
        import nicegui  # noqa: F401  tested before a port is opened
        import uvicorn
    from markerseek.bridges.page.application import page_application

    class Server(uvicorn.Server):
        """Stops the searches with the first signal, not only once the connections are closed."""

        def handle_exit(self, sig: int, frame: FrameType | None) -> None:
            super().handle_exit(sig, frame)
            # In a thread, and not here: what the signal has interrupted may hold a lock.
            closing = threading.Thread(target=searches.close, name="close", daemon=True)
            asyncio.get_running_loop().call_soon_threadsafe(closing.start)

    token = secrets.token_urlsafe(32)
    with address.listening() as listener:
        port = listener.getsockname()[1]
        names = _LOOPBACK_NAMES if address.host in _LOOPBACK_NAMES else {address.host}
        # Browsers leave the usual port of a scheme out of the Host header.
        usual = port == {"http": 80, "https": 443}[address.scheme]
        access = Access(
            token=token,
            hosts=frozenset(name if usual else f"{name}:{port}" for name in names),
            scheme=address.scheme,
            cookie=f"markerseek_{port}",
        )
        application = SecurityLayer(page_application(searches, unwatched_s=UNWATCHED_S), access)
        config = uvicorn.Config(
            application,
            log_level="warning",
            access_log=False,
            ws_max_size=BODY_BYTES,
            ssl_certfile=address.certificate,
            ssl_keyfile=address.key,
            # A viewer that does not answer any more must not hold up the end.
            timeout_graceful_shutdown=1,
            server_header=False,
        )
        # Ctrl-C is the ordinary end of the page.
        with suppress(KeyboardInterrupt):
            on_ready(f"{address.scheme}://{address.host}:{port}/?{TOKEN_PARAMETER}={token}")
            asyncio.run(Server(config).serve(sockets=[listener]))
