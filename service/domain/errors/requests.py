"""A request as such, and a service that cannot answer it now."""

from __future__ import annotations

from service.domain.errors.tree import Conflict, Rejected, Unavailable


class InvalidRequest(Rejected):
    """The body, a field, a header or a query parameter is not what the API asks for.

    `errors` lists each place as a JSON pointer with a sentence.
    """

    title = "The request is not valid"


class IdempotencyKeyReused(Rejected):
    """The `Idempotency-Key` was used before with another request; take a new key for a new request."""

    title = "The idempotency key belongs to another request"


class IdempotencyKeyBusy(Conflict):
    """A request with the same `Idempotency-Key` is being worked on; ask again in a moment."""

    title = "The same request is being worked on"


class DatabaseBusy(Unavailable):
    """The database did not answer in time; ask again after the `Retry-After` seconds."""

    title = "The database is busy"


class StorageFull(Unavailable):
    """The server's disk is full, or has less free than is kept in reserve: an admin has to make room.

    Nothing is half stored. Send the same request again after the `Retry-After` seconds; an upload in pieces
    goes on from its offset. A job that finds no room stays queued with this problem, and is tried again by
    itself when there is room; one that began with room `tries` times, and found the disk full each time, has
    failed with it: it needs more than there was. What is stored can be looked at and downloaded meanwhile.
    `free_bytes` and `reserve_bytes` tell how the disk stood, for such a job when it was begun last.
    """

    title = "The storage is full"


class TooManyRequests(Unavailable):
    """The key has sent more requests within a minute than one key may; `RateLimit-Policy` tells how many.

    Ask again after the `Retry-After` seconds. `RateLimit` tells with every answer how many are left. Many
    robots take a key each.
    """

    title = "The key sends too many requests"


class TooManyStreams(Unavailable):
    """The key has as many event streams open as one key may have; `max_streams` tells how many.

    Close one, or ask again after the `Retry-After` seconds. Many listeners take a key each.
    """

    title = "The key has too many streams"


class NotReady(Unavailable):
    """The service is up, but something that it needs is not; `checks` tells what."""

    title = "The service is not ready"
