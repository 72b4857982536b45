"""Make, check, list and revoke API keys."""

from __future__ import annotations

import base64
import hashlib
import hmac
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from service.db import keys as table
from service.db.maps import find_maps
from service.db.models import Key
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import InvalidRequest, KeyNotFound, LastAdminKey, MapNotFound, Unauthenticated
from service.domain.lifecycle import Role
from service.usecases.audit import record
from service.usecases.kernel import Kernel

_PREFIX = "gp_"
_SECRET_BYTES = 32
_MAX_SECRET_CHARACTERS = 100
_FIRST_KEY_ID = "key_" + "0" * 26
"""Id of the key made at the first start: fixed, so that of two services starting only one makes it."""


@dataclass(frozen=True)
class NewKey:
    """Hold a key just made, with its secret, which is shown once and kept nowhere."""

    key: Key
    secret: str


def authenticate(session: Session, secret: str | None, *, now: datetime) -> Actor:
    """Return who holds the secret.

    Raises
    ------
    Unauthenticated
        If there is no secret, or its key is unknown, revoked or expired.
    """
    if not secret:
        raise Unauthenticated("Send an API key: `Authorization: Bearer gp_...`.")
    digest = secret_digest(secret[:_MAX_SECRET_CHARACTERS])
    key = table.find_by_digest(session, digest) if len(secret) <= _MAX_SECRET_CHARACTERS else None
    if key is None:
        raise Unauthenticated("The API key is not known here.")
    if key.revoked_at is not None:
        raise Unauthenticated("The API key was revoked; ask an admin for a new one.")
    if key.expires_at is not None and key.expires_at <= now:
        raise Unauthenticated("The API key has expired; ask an admin for a new one.")
    return Actor(key.id, Role(key.role), None if key.map_ids is None else frozenset(key.map_ids))


def create_key(
    kernel: Kernel,
    session: Session,
    *,
    name: str,
    role: Role,
    map_ids: Sequence[str] | None = None,
    expires_at: datetime | None = None,
    root: str | None = None,
) -> NewKey:
    """Return a new key with its secret; only the secret's SHA-256 is kept.

    Parameters
    ----------
    root : str, optional
        Derive the secret from this one and the new key's id, as `derived_secret`, so that the answer
        can be given again without being kept.

    Raises
    ------
    MapNotFound
        If one of `map_ids` is no map.
    InvalidRequest
        If the key would be expired from the start.
    """
    if map_ids is not None:
        missing = set(map_ids) - {row.id for row in find_maps(session, sorted(set(map_ids)))}
        if missing:
            raise MapNotFound(f"There is no map {min(missing)}.")
    if expires_at is not None and expires_at <= kernel.now():
        detail = "expires_at lies in the past."
        raise InvalidRequest(detail, errors=[{"pointer": "#/expires_at", "detail": detail}])
    made = _new_key(kernel, kernel.new_id("key"), name=name, role=role, root=root)
    made.key.map_ids = None if map_ids is None else sorted(set(map_ids))
    made.key.expires_at = expires_at
    table.add_key(session, made.key)
    return made


def create_first_key(kernel: Kernel) -> NewKey | None:
    """Return the first admin key, made now, or None when there is or ever was a key.

    Of several services that start at once exactly one gets the key.
    """
    with kernel.db.writing("create-first-key") as session:
        made = _new_key(kernel, _FIRST_KEY_ID, name="first admin", role=Role.ADMIN)
        return made if table.is_empty(session) and table.add_key(session, made.key) else None


def create_key_at_the_console(kernel: Kernel, *, name: str, role: Role, map_ids: list[str] | None) -> NewKey:
    """Return a new key, made in a transaction of its own, for an operator on the server itself."""
    with kernel.db.writing("create-key") as session:
        made = create_key(kernel, session, name=name, role=role, map_ids=map_ids)
        after = {"name": name, "role": role.value, "map_ids": map_ids, "at": "the console"}
        record(kernel, session, None, action="create-key", subject_id=made.key.id, after=after)
        return made


def list_keys(session: Session, actor: Actor, *, after: str | None, limit: int) -> Sequence[Key]:
    """Return keys in the order of their making.

    Raises
    ------
    Forbidden
        If `actor` is no admin of all maps.
    """
    _require_key_admin(actor)
    return table.list_keys(session, after=after, limit=limit)


def make_key(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    name: str,
    role: Role,
    map_ids: Sequence[str] | None,
    expires_at: datetime | None,
    root: str | None = None,
) -> NewKey:
    """Return a new key that `actor` asked for.

    Raises
    ------
    Forbidden
        If `actor` is no admin of all maps.
    MapNotFound, InvalidRequest
        As `create_key`.
    """
    _require_key_admin(actor)
    made = create_key(
        kernel, session, name=name, role=role, map_ids=map_ids, expires_at=expires_at, root=root
    )
    after = {"name": name, "role": role.value, "map_ids": made.key.map_ids}
    record(kernel, session, actor, action="create-key", subject_id=made.key.id, after=after)
    return made


def derived_secret(root: str, *, key_id: str) -> str:
    """Return the secret of the key `key_id` that was made with the secret `root` and an Idempotency-Key.

    HMAC-SHA-256 of the new key's id under the maker's own secret: whoever lacks that secret, the
    database's reader included, learns nothing; the maker was told the result anyway.
    """
    return _encoded(hmac.digest(root.encode(), b"groundplan key " + key_id.encode(), "sha256"))


def revoke_key(kernel: Kernel, session: Session, actor: Actor, *, key_id: str) -> None:
    """Make a key invalid at once.

    Raises
    ------
    Forbidden
        If `actor` is no admin of all maps.
    KeyNotFound
        If there is no such key.
    LastAdminKey
        If no other admin key of all maps is valid for as long.
    """
    _require_key_admin(actor)
    admins = table.lock_admin_keys(session, now=kernel.now())
    found = table.find_key(session, key_id)
    if found is None:
        raise KeyNotFound(f"There is no key {key_id}.")
    if found.revoked_at is None:
        _require_another(admins, found)
        table.revoke_key(session, key_id, now=kernel.now())
        record(kernel, session, actor, action="revoke-key", subject_id=key_id, before={"name": found.name})


def _require_another(admins: Sequence[Key], going: Key) -> None:
    """Pass when, of the admin keys, one that stays is valid for as long as the one that goes."""
    if all(key.id != going.id for key in admins):
        return
    ends = going.expires_at
    for key in admins:
        if key.id != going.id and (key.expires_at is None or (ends is not None and key.expires_at >= ends)):
            return
    until = "without an end" if ends is None else f"until {ends.isoformat()}"
    raise LastAdminKey(
        f"No other admin key of all maps is valid {until}, as {going.name!r} is: make one first, then revoke "
        "this one."
    )


def _require_key_admin(actor: Actor) -> None:
    actor.require_role(Role.ADMIN)
    actor.require_all_maps()


def _new_key(kernel: Kernel, key_id: str, *, name: str, role: Role, root: str | None = None) -> NewKey:
    random = _encoded(kernel.entropy(_SECRET_BYTES))
    secret = random if root is None else derived_secret(root, key_id=key_id)
    row = Key(id=key_id, name=name, role=role.value, digest=secret_digest(secret), created_at=kernel.now())
    return NewKey(row, secret)


def _encoded(secret: bytes) -> str:
    return _PREFIX + base64.urlsafe_b64encode(secret).decode().rstrip("=")


def secret_digest(secret: str) -> str:
    """Return what is kept of a secret: its SHA-256 (hex)."""
    return hashlib.sha256(secret.encode()).hexdigest()
