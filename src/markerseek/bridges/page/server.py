"""Serves the page: address, certificate, token."""

from __future__ import annotations

import errno
import logging
import re
import secrets
import socket
import ssl
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv6Address
from pathlib import Path
from types import FrameType
from urllib.parse import SplitResult, urlsplit

from markerseek.bridges.page.connections import Listener
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.core import ConfigError, needs_package

_LOOPBACK = "127.0.0.1"
"""Address that only programs on this computer reach."""

_LOOPBACK_NAMES = frozenset({_LOOPBACK, "::1", "localhost"})

_FOREIGN = "name an address of this computer as `host`"

USUAL_PORT = 8765
"""Port where none is named."""

MESSAGE_BYTES = 64 * 1024
"""Largest message of a browser, in bytes."""

_PORTS = {"http": 80, "https": 443}

_PATH = re.compile(r"(/[\w.~@+:-]+)*/?", re.ASCII)
"""A path that needs no escape where it is written into a page."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Address:
    """Where the page is served."""

    host: str = _LOOPBACK
    """Address or name of this computer."""
    port: int = USUAL_PORT
    """Port; 0 takes any that is free."""
    certificate: Path | None = None
    """PEM file for TLS; needed for any address that other computers reach."""
    key: Path | None = None
    """PEM file with the key of the certificate."""
    public_url: str | None = None
    """Address in a browser at the other end of a tunnel or proxy, such as ``http://localhost:9000``."""
    ip: IPv4Address | IPv6Address = field(init=False)

    def __post_init__(self) -> None:
        try:
            ip = _resolved(self.host)
        except (OSError, ValueError) as problem:
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
                f"host is {self.host}: other computers reach it, which needs TLS; name `tls_certificate` "
                f"and `tls_key`, or leave the host out for {_LOOPBACK}"
            )
        # Checked now, not once the page is served.
        _ = self._public_parts
        if self.certificate is not None and self.key is not None:
            try:
                ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(self.certificate, self.key)
            except (OSError, ssl.SSLError) as problem:
                raise ConfigError(
                    f"{self.certificate}, {self.key}: no certificate with its key: {problem}"
                ) from problem

    @property
    def _public_parts(self) -> SplitResult | None:
        """Parts of ``public_url``; `ConfigError` if it cannot be used."""
        if self.public_url is None:
            return None
        wrong = ConfigError(
            f"public url is {self.public_url!r}: name what stands in the browser, http://localhost:PORT or "
            "https://NAME, behind a proxy with its path, http://localhost:8888/proxy/8765/; http is for localhost, "
            "127.0.0.1 and [::1] only, others would see the token"
        )
        try:
            parts = urlsplit(self.public_url)
            # Reading the port checks it.
            _ = parts.port
        except ValueError as problem:
            raise wrong from problem
        bare = _PATH.fullmatch(parts.path) and not (parts.query or parts.fragment or "@" in parts.netloc)
        private = parts.scheme == "https" or (parts.scheme == "http" and parts.hostname in _LOOPBACK_NAMES)
        climbs = {".", ".."} & set(parts.path.split("/"))
        if not parts.hostname or parts.port == 0 or not bare or not private or climbs:
            raise wrong
        return parts

    @property
    def public(self) -> str | None:
        """Origin of ``public_url`` as browsers send it: in small letters, without the usual port of its scheme."""
        parts = self._public_parts
        if parts is None or parts.hostname is None:
            return None
        return _origin(parts.scheme, parts.hostname, parts.port or _PORTS[parts.scheme])

    @property
    def prefix(self) -> str:
        """Path of ``public_url``, without a slash at its end; empty if the page is no part of another site."""
        parts = self._public_parts
        return "" if parts is None else parts.path.rstrip("/")

    def origins(self, port: int) -> set[str]:
        """Return the origins of a page that is served at this port: scheme, name and port, as browsers send them."""
        names = {self.host.lower().strip("[]"), str(self.ip)}
        if str(self.ip) in _LOOPBACK_NAMES:
            names.add("localhost")
        own = {_origin(self.scheme, name, port) for name in names}
        return own | ({self.public} if self.public else set())

    def link(self, port: int, query: str) -> str:
        """Return a link to the page that is served at this port, as a browser opens it."""
        origin = self.public or _origin(self.scheme, self.host.strip("[]"), port)
        return f"{origin}{self.prefix}/?{query}"

    @property
    def scheme(self) -> str:
        """``https`` with a certificate, else ``http``."""
        return "http" if self.certificate is None else "https"

    def listening(self) -> socket.socket:
        """Return a socket that listens there."""
        try:
            family = socket.AF_INET6 if self.ip.version == 6 else socket.AF_INET
            return socket.create_server((str(self.ip), self.port), family=family)
        except OSError as problem:
            # An address of another computer is no better on another port.
            cure = _FOREIGN if problem.errno == errno.EADDRNOTAVAIL else "name another `port`"
            raise ConfigError(
                f"{self.host}:{self.port}: the page cannot be served there: {problem.strerror}; {cure}"
            ) from problem


def _resolved(host: str) -> IPv4Address | IPv6Address:
    """Return the address that a host names: what is judged is what is listened on.

    "0" is all addresses, "0x7f.1" the loopback address, and "::ffff:127.0.0.1" an address of IPv4. Raises `OSError` or
    `ValueError` if there is none.
    """
    if ":" not in host:
        return IPv4Address(socket.gethostbyname(host))
    ip = IPv6Address(host[1:-1] if host.startswith("[") and host.endswith("]") else host)
    return ip.ipv4_mapped or ip


def _origin(scheme: str, name: str, port: int) -> str:
    """Return an origin as browsers send it: an address of IPv6 in brackets, the usual port of the scheme left out."""
    shown = f"[{name}]" if ":" in name else name
    return f"{scheme}://{shown}" if port == _PORTS[scheme] else f"{scheme}://{shown}:{port}"


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
    with address.listening() as listening, Listener(listening) as listener:
        port = listener.getsockname()[1]
        token = secrets.token_urlsafe(32)
        once = secrets.token_urlsafe(32)
        application = page_application(
            searches,
            connections=listener,
            origins=address.origins(port),
            prefix=address.prefix,
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
        on_ready(address.link(port, f"token={token}"), address.link(port, f"once={once}"))
        # Ctrl-C is the ordinary end of the page.
        with suppress(KeyboardInterrupt):
            Server(config).run(sockets=[listener])
