"""How this process speaks HTTP: what each answer says to browsers, also those to no request at all."""

from __future__ import annotations

from http import HTTPStatus

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
}


def headers_of_all_answers(*, hsts_s: int) -> list[tuple[str, str]]:
    """Return the headers that stand on every answer, whatever it is; a page's policy is its own.

    Parameters
    ----------
    hsts_s : int
        Seconds for which browsers come back by HTTPS alone; 0 where they do not have to.
    """
    told = list(_HEADERS.items())
    if hsts_s:
        told.append(("Strict-Transport-Security", f"max-age={hsts_s}"))
    return told


class Http(H11Protocol):
    """Uvicorn's protocol, whose answer to what is no HTTP has the headers of all answers, too."""

    def send_400_response(self, msg: str) -> None:
        """Answer what is no request, and close."""
        told = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
        begin = h11.Response(
            status_code=HTTPStatus.BAD_REQUEST,
            headers=[*told, *self.server_state.default_headers],
            reason=HTTPStatus.BAD_REQUEST.phrase.encode(),
        )
        for event in (begin, h11.Data(data=msg.encode("ascii")), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()
