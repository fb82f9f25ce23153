"""Serves the page: address, certificate, token."""

from __future__ import annotations

import errno
import logging
import secrets
import socket
import ssl
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from ipaddress import IPv4Address
from pathlib import Path
from types import FrameType
from urllib.parse import urlsplit

from markerseek.bridges.page.page_searches import PageSearches
from markerseek.core import ConfigError, needs_package

LOOPBACK = "127.0.0.1"
"""Address that only programs on this computer reach."""

_LOOPBACK_NAMES = frozenset({LOOPBACK, "localhost"})

_FOREIGN = "name an IPv4 address of this computer as --host"

USUAL_PORT = 8765
"""Port where none is named."""

MESSAGE_BYTES = 64 * 1024
"""Largest message of a browser, in bytes."""

_PORTS = {"http": 80, "https": 443}


@dataclass(frozen=True, slots=True, kw_only=True)
class Address:
    """Where the page is served."""

    host: str = LOOPBACK
    """Address or name of this computer."""
    port: int = USUAL_PORT
    """Port; 0 takes any that is free."""
    certificate: Path | None = None
    """PEM file for TLS; needed for any address that other computers reach."""
    key: Path | None = None
    """PEM file with the key of the certificate."""
    public_url: str | None = None
    """Address in a browser at the other end of a tunnel, such as ``http://localhost:9000``."""
    ip: IPv4Address = field(init=False)

    def __post_init__(self) -> None:
        try:
            # What is judged is what is listened on: "0" is all addresses, "0x7f.1" the loopback address.
            ip = IPv4Address(socket.gethostbyname(self.host))
        except (OSError, UnicodeError) as problem:
            raise ConfigError(f"host is {self.host!r}: {_FOREIGN}") from problem
        object.__setattr__(self, "ip", ip)
        if ip.is_unspecified:
            raise ConfigError(
                f"host is {self.host!r}: name the one address of this computer that others open, such as 192.168.1.5"
            )
        if not 0 <= self.port <= 65535:
            raise ConfigError(f"port is {self.port}, it must lie between 0 and 65535; {USUAL_PORT} is usual")
        if (self.certificate is None) != (self.key is None):
            raise ConfigError("TLS needs both a certificate and its key; name both, or neither")
        if not ip.is_loopback and self.certificate is None:
            raise ConfigError(
                f"host is {self.host}: other computers reach it, which needs TLS; name --tls-certificate "
                f"and --tls-key, or leave the host out for {LOOPBACK}"
            )
        # Checked now, not once the page is served.
        _ = self.public
        if self.certificate is not None and self.key is not None:
            try:
                ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(self.certificate, self.key)
            except (OSError, ssl.SSLError) as problem:
                raise ConfigError(
                    f"{self.certificate}, {self.key}: no certificate with its key: {problem}"
                ) from problem

    @property
    def public(self) -> str | None:
        """Origin of ``public_url`` as browsers send it: in small letters, without the usual port of its scheme."""
        if self.public_url is None:
            return None
        wrong = ConfigError(
            f"public url is {self.public_url!r}: name what stands in the browser, http://localhost:PORT or "
            "https://NAME, without a path; http is for localhost and 127.0.0.1 only, others would see the token"
        )
        try:
            parts = urlsplit(self.public_url)
            name, port = parts.hostname, parts.port
        except ValueError as problem:
            raise wrong from problem
        bare = parts.path in ("", "/") and not (parts.query or parts.fragment or "@" in parts.netloc)
        private = parts.scheme == "https" or (parts.scheme == "http" and name in _LOOPBACK_NAMES)
        if not name or not bare or not private:
            raise wrong
        usual = port in (None, _PORTS[parts.scheme])
        return f"{parts.scheme}://{name}" if usual else f"{parts.scheme}://{name}:{port}"

    @property
    def scheme(self) -> str:
        """``https`` with a certificate, else ``http``."""
        return "http" if self.certificate is None else "https"

    def listening(self) -> socket.socket:
        """A socket that listens there."""
        try:
            return socket.create_server((str(self.ip), self.port))
        except OSError as problem:
            # An address of another computer is no better on another port.
            cure = _FOREIGN if problem.errno == errno.EADDRNOTAVAIL else "name another --port"
            raise ConfigError(
                f"{self.host}:{self.port}: the page cannot be served there: {problem.strerror}; {cure}"
            ) from problem


def serve(searches: PageSearches, address: Address, *, on_ready: Callable[[str, str], None]) -> None:
    """Serve the page until SIGINT or SIGTERM; searches that run then are stopped.

    Parameters
    ----------
    searches
        The searches of the page.
    address
        Where the page is served.
    on_ready
        Called once the port is open, with the link that holds a new token, and with a link that works one time.
    """
    with needs_package("nicegui", extra="page", purpose="the live page"):
        import nicegui  # noqa: F401  tested before a port is opened
        import uvicorn
    from markerseek.bridges.page.application import page_application
    from markerseek.bridges.page.run_history import warm_up

    class Server(uvicorn.Server):
        """Stops the searches with the first signal, not only once the connections are closed."""

        def handle_exit(self, sig: int, frame: FrameType | None) -> None:
            if not self.should_exit:
                # In a thread: what the signal has interrupted may hold a lock.
                threading.Thread(target=searches.stop, daemon=True).start()
                # Traces of connections that the end cuts off say nothing.
                logging.disable()
                super().handle_exit(sig, frame)

    # While kernels are loaded the event loop takes no STOP: before the port is open.
    warm_up()
    searches.offer_interrupted()
    with address.listening() as listener:
        port = listener.getsockname()[1]
        # Browsers send names in small letters.
        names = {address.host.lower(), str(address.ip)} | (_LOOPBACK_NAMES if str(address.ip) == LOOPBACK else set())
        own = {f"{address.scheme}://{name}" for name in names}
        # Browsers leave out the usual port of a scheme.
        own |= {f"{each}:{port}" for each in own} if port != _PORTS[address.scheme] else set()
        token, once = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        application = page_application(
            searches,
            origins=own | ({address.public} if address.public else set()),
            token=token,
            once=once,
            cookie=f"markerseek_{port}",
            secure=address.certificate is not None,
        )
        config = uvicorn.Config(
            application,
            loop="asyncio",
            # Strangers must not write into the terminal in which a rig is armed.
            log_level="error",
            access_log=False,
            # Its usual parser, httptools, keeps a header of any length.
            http="h11",
            ws_max_size=MESSAGE_BYTES,
            # No proxy is in front: whose connection it is, is not for a header to say.
            proxy_headers=False,
            ssl_certfile=address.certificate,
            ssl_keyfile=address.key,
            # A viewer that does not answer any more must not hold up the end.
            timeout_graceful_shutdown=1,
            server_header=False,
        )
        origin = address.public or f"{address.scheme}://{address.host}:{port}"
        on_ready(f"{origin}/?token={token}", f"{origin}/?once={once}")
        # Ctrl-C is the ordinary end of the page.
        with suppress(KeyboardInterrupt):
            Server(config).run(sockets=[listener])
