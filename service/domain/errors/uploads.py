"""Bytes on their way in, whole or in pieces."""

from __future__ import annotations

from service.domain.errors.tree import Conflict, NotFound, Rejected


class UploadNotFound(NotFound):
    """No upload in pieces has this id, or another key began it."""

    title = "No such upload"


class UploadExpired(NotFound):
    """The upload in pieces was not finished in time, and what had come of it is gone.

    Begin it again by `POST /v1/tus`; `Upload-Expires` tells how long it may take.
    """

    title = "The upload has expired"


class UploadBusy(Conflict):
    """Another request is writing to the same upload in pieces.

    A connection that broke holds its upload for some seconds: wait for `retry_after_s`, ask for the offset
    by `HEAD`, and go on from there.
    """

    title = "The upload is being written to"


class UploadOffsetMismatch(Conflict):
    """The piece does not begin where the stored bytes end; `upload_offset` tells where that is."""

    title = "The piece begins at another offset"


class BodyNotTaken(Rejected):
    """The body is not of the kind that this address takes: `content_type` names what it is to be.

    Say it in the header `Content-Type`, and send the body accordingly.
    """

    title = "This kind of body is not taken"


class CodingNotOffered(Rejected):
    """`Accept-Encoding` forbids every form in which the file can be sent: `offered` lists them.

    `identity` is the bare file, which alone can be sent in parts.
    """

    title = "The file cannot be sent in a coding that is accepted"


class UploadTooLarge(Rejected):
    """The upload is larger than this server takes; `max_upload_bytes` tells how much it takes."""

    title = "The upload is too large"


class UploadInterrupted(Rejected):
    """The request ended, or fell silent, before all of its body had come.

    Of an upload in one piece nothing was kept: send it again. An upload in pieces goes on from its offset.
    """

    title = "The upload was interrupted"


class ChecksumMismatch(Rejected):
    """The piece is not what its `Upload-Checksum` says: it was damaged on the way and has been discarded.

    Send it again from the same offset.
    """

    title = "The checksum does not match"


class ChecksumUnsupported(Rejected):
    """The `Upload-Checksum` names an algorithm that is not known here, or is no checksum at all.

    `OPTIONS /v1/tus` lists the algorithms in `Tus-Checksum-Algorithm`.
    """

    title = "The checksum cannot be checked"


class TusVersionUnsupported(Rejected):
    """The request has no `Tus-Resumable: 1.0.0`, the one version of the protocol that is spoken here."""

    title = "This version of tus is not spoken here"


class TusExtensionNotOffered(Rejected):
    """A header of the request belongs to an extension of tus that is not offered here: `extension` names it.

    `OPTIONS /v1/tus` lists in `Tus-Extension` what is offered. Send the file as one upload of known length.
    """

    title = "This extension of tus is not offered here"
