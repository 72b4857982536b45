"""Sign links to files that work without a key until they expire, for devices that take only an address."""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from urllib.parse import quote

from service.db.keys import find_key
from service.db.models import Key
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import LinkNotValid
from service.domain.lifecycle import Role
from service.usecases.download import StoredFile, artifact_file
from service.usecases.kernel import Kernel

LONGEST_S = 7 * 24 * 3600


@dataclass(frozen=True)
class Signature:
    """Hold what makes a link work: whose key signed it, until when (seconds since 1970), and the proof."""

    key_id: str
    expires: int
    proof: str


@dataclass(frozen=True)
class SignedFile:
    """Hold a file and the signature of a link to it."""

    file: StoredFile
    signature: Signature
    expires_at: datetime


def sign_link(
    kernel: Kernel, session: Session, actor: Actor, *, map_id: str, n: int, path: str, valid_s: int
) -> SignedFile:
    """Return a file with the signature of a link to it.

    The link does what the actor's key may do and no more, and dies with the key.

    Parameters
    ----------
    valid_s : int
        Seconds until the link expires, at most `LONGEST_S`.

    Raises
    ------
    MapNotFound, RevisionNotFound, RevisionNotReady, ArtifactNotFound
        As `artifact_file`.
    """
    assert 0 < valid_s <= LONGEST_S
    file = artifact_file(kernel, session, actor, map_id=map_id, n=n, path=path)
    key = find_key(session, actor.key_id)
    assert key is not None
    expires = int((kernel.now() + timedelta(seconds=valid_s)).timestamp())
    proof = _proof(key, map_id=map_id, n=n, path=path, expires=expires)
    return SignedFile(file, Signature(key.id, expires, proof), datetime.fromtimestamp(expires, UTC))


def link_path(signature: Signature, *, map_id: str, n: int, path: str) -> str:
    """Return what of a link's address follows that of the service."""
    asked = f"key={signature.key_id}&expires={signature.expires}&signature={signature.proof}"
    return f"/v1/links/{map_id}/{n}/{quote(path)}?{asked}"


def linked_file(
    kernel: Kernel, session: Session, signature: Signature, *, map_id: str, n: int, path: str
) -> StoredFile:
    """Return the file that a link leads to.

    Raises
    ------
    LinkNotValid
        If the link was altered, has expired, or its key was revoked or has expired.
    MapNotFound, RevisionNotFound, RevisionNotReady, ArtifactNotFound
        As `artifact_file`.
    """
    now = kernel.now()
    key = find_key(session, signature.key_id)
    expected = "" if key is None else _proof(key, map_id=map_id, n=n, path=path, expires=signature.expires)
    if key is None or not hmac.compare_digest(expected.encode(), signature.proof.encode()):
        raise LinkNotValid("The link is not one that this service has signed; ask for a new one.")
    if signature.expires <= now.timestamp():
        raise LinkNotValid("The link has expired; ask for a new one.")
    if key.revoked_at is not None or (key.expires_at is not None and key.expires_at <= now):
        raise LinkNotValid("The key that the link was signed with is no longer valid; ask for a new one.")
    actor = Actor(key.id, Role(key.role), None if key.map_ids is None else frozenset(key.map_ids))
    return artifact_file(kernel, session, actor, map_id=map_id, n=n, path=path)


def _proof(key: Key, *, map_id: str, n: int, path: str, expires: int) -> str:
    """Return HMAC-SHA-256 over all that the link says, under the key's digest, which no answer tells."""
    message = "\n".join(("groundplan link", key.id, map_id, str(n), str(expires), path))
    return hmac.digest(bytes.fromhex(key.digest), message.encode(), "sha256").hex()
