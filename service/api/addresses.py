"""Under which address clients reach the service: what was set, else a name that this machine has itself."""

from __future__ import annotations

import re
import socket
from collections.abc import Iterable

from starlette.types import Scope

_LOOPBACK = frozenset({"localhost", "127.0.0.1", "[::1]"})
_HOST = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(:[0-9]{1,5})?")


class Addresses:
    """Tell the address for links in answers: never one that the request alone has named.

    Parameters
    ----------
    public_url : str, optional
        The one address, where it was set.
    hosts : iterable of str
        Names and addresses, beside those of this machine, that a request's `Host` may have.
    """

    def __init__(self, public_url: str | None, *, hosts: Iterable[str] = ()) -> None:
        self._public_url = None if public_url is None else public_url.rstrip("/")
        own = socket.gethostname().lower()
        self._hosts = _LOOPBACK | {own, f"{own}.local", socket.getfqdn().lower(), *map(str.lower, hosts)}

    def base_url(self, scope: Scope) -> str:
        """Return the address for links, without a slash at its end.

        Without a public URL it is the `Host` of the request, if that is a name of this machine or the
        address at which the request has come; else that address.
        """
        if self._public_url is not None:
            return self._public_url
        address, port = scope["server"]
        here = f"[{address}]" if ":" in address else address
        named = next((value for name, value in scope["headers"] if name == b"host"), b"")
        host = _HOST.fullmatch(named.decode("latin-1").lower())
        if host is not None and (host[1] in self._hosts or host[1] == here):
            return f"{scope['scheme']}://{host[0]}"
        return f"{scope['scheme']}://{here}:{port}"
