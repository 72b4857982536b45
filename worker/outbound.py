"""Send a request to an address that somebody else named: to allowed addresses alone, without redirects."""

from __future__ import annotations

import http.client
import ipaddress
import socket
import ssl
import threading
from collections.abc import Mapping, Sequence
from urllib.parse import SplitResult, urlsplit

from service.domain.outbound import Address, Network, may_send_to

_OPERATION_S = 5.0
_WHOLE_S = 10.0


class NotSent(Exception):
    """There was no answer; the sentence tells why."""


def post(url: str, *, body: bytes, headers: Mapping[str, str], allowed: Sequence[Network]) -> int:
    """Return the HTTP status of the answer; its body is not read, and no redirect is followed.

    The host's name is resolved once, and the connection goes to an address that was checked: a name that
    leads elsewhere the next moment leads nowhere else here.

    Parameters
    ----------
    allowed : sequence of networks
        Where requests may go, although these are no public addresses.

    Raises
    ------
    NotSent
        If no address of the host may be sent to, or there was no answer in time.
    """
    parts = urlsplit(url)
    address = _resolve(parts, allowed=allowed)
    connection = _connection(parts, address)
    watch = threading.Timer(_WHOLE_S, _break_off, [connection])
    watch.start()
    try:
        target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        connection.request("POST", target, body=body, headers=dict(headers))
        return connection.getresponse().status
    except (OSError, http.client.HTTPException) as error:
        raise NotSent(f"{address}: {error or type(error).__name__}") from error
    finally:
        watch.cancel()
        connection.close()


class _PinnedHTTPConnection(http.client.HTTPConnection):
    """Connect to one address, whatever the host's name leads to."""

    def __init__(self, parts: SplitResult, address: Address) -> None:
        super().__init__(parts.hostname or "", parts.port, timeout=_OPERATION_S)
        self._address = str(address)

    def connect(self) -> None:
        self.sock = socket.create_connection((self._address, self.port), self.timeout)


class _PinnedHTTPSConnection(http.client.HTTPSConnection):
    """Connect to one address, and hold its certificate against the host's name."""

    def __init__(self, parts: SplitResult, address: Address) -> None:
        self._tls = ssl.create_default_context()
        super().__init__(parts.hostname or "", parts.port, timeout=_OPERATION_S, context=self._tls)
        self._address = str(address)

    def connect(self) -> None:
        plain = socket.create_connection((self._address, self.port), self.timeout)
        try:
            self.sock = self._tls.wrap_socket(plain, server_hostname=self.host)
        except OSError:
            plain.close()
            raise


def _connection(parts: SplitResult, address: Address) -> http.client.HTTPConnection:
    if parts.scheme == "https":
        return _PinnedHTTPSConnection(parts, address)
    return _PinnedHTTPConnection(parts, address)


def _resolve(parts: SplitResult, *, allowed: Sequence[Network]) -> Address:
    host = parts.hostname or ""
    try:
        found = socket.getaddrinfo(host, parts.port or 0, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:  # UnicodeError: no name, as with a part of 64 letters
        raise NotSent(f"{host} leads to no address: {error}") from error
    addresses = [ipaddress.ip_address(str(entry[4][0]).partition("%")[0]) for entry in found]
    for address in addresses:
        if may_send_to(address, allowed=allowed):
            return address
    raise NotSent(f"{host} leads to {addresses[0]}, which is no public address and not allowed")


def _break_off(connection: http.client.HTTPConnection) -> None:
    """End an exchange that takes too long, however busy it is."""
    if connection.sock is not None:
        connection.sock.shutdown(socket.SHUT_RDWR)
