"""Who asks, and what their key allows."""

from __future__ import annotations

from service.domain.errors.tree import Conflict, Denied, NotFound


class Unauthenticated(Denied):
    """No key, or a key that is unknown, revoked or expired.

    Send `Authorization: Bearer gp_...` with a key that an admin made by `POST /v1/keys` or
    `groundplan key create`.
    """

    title = "A valid API key is needed"


class Forbidden(Denied):
    """The key is valid, but its role or its maps do not allow this.

    Ask an admin for a key of the role that `required_roles` names, or for one that covers the map.
    """

    title = "The key does not allow this"


class OriginNotProven(Denied):
    """A change was asked for with a session cookie alone, which a browser also sends for foreign pages.

    Send the header `X-Groundplan-Session: 1` with it, which no foreign page can, or use
    `Authorization: Bearer gp_...` in place of the cookie.
    """

    title = "The request may come from a foreign page"


class LinkNotValid(Denied):
    """The signed link was altered, has expired, or was signed with a key that is no longer valid.

    Ask for a new one by `GET /v1/maps/{map_id}/revisions/{n}/link`.
    """

    title = "The link is not valid"


class KeyNotFound(NotFound):
    """No API key with this id exists."""

    title = "No such key"


class LastAdminKey(Conflict):
    """No other admin key of all maps is valid for as long as this one: without it, nobody could make keys.

    Make another by `POST /v1/keys` with the role `admin`, no `map_ids`, and no earlier `expires_at`; then
    revoke this one with it. Where every admin key is lost, `groundplan key create --role admin` makes one on
    the server.
    """

    title = "The last admin key cannot be revoked"
