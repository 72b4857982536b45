"""The refusals of the product: one tree, one leaf a fact.

DomainError
├── Denied        who asks is unknown, or may not do this
├── NotFound      the thing named does not exist, or not for this caller
├── Conflict      right in itself, but not in the present state
├── Rejected      the input is wrong, and will be wrong the next time too
├── Unfulfilled   the work was done and its result is not good enough; never answers a request
└── Unavailable   not now; the same call may succeed later

A leaf's docstring is its public page, its class name in kebab-case its slug, and `title` its fixed
title. Which HTTP status a class has is decided in `service.api.problems` alone.
"""

from __future__ import annotations

import re
from typing import Any, ClassVar


class DomainError(Exception):
    """Return a refusal that a caller can act on.

    Parameters
    ----------
    detail : str
        What was found and what to do, as a sentence for the person who asked.
    **members : object
        Machine-readable facts (JSON values), shown beside the sentence.
    """

    title: ClassVar[str] = "The request was refused"

    def __init__(self, detail: str, **members: Any) -> None:
        super().__init__(detail)
        self.detail = detail
        self.members = members

    @classmethod
    def slug(cls) -> str:
        """Return the stable name of this refusal, as it stands in the problem's ``type``."""
        return re.sub(r"(?<!^)(?=[A-Z])", "-", cls.__name__).lower()

    def problem(self) -> dict[str, Any]:
        """Return the refusal as the members of an RFC 9457 document, without type URL and status.

        The ``slug`` stands in for the type: the edge that knows the public address completes it.
        """
        return {"slug": self.slug(), "title": self.title, "detail": self.detail, **self.members}


class Denied(DomainError):
    """Who asks is unknown, or may not do this."""


class NotFound(DomainError):
    """The thing named does not exist, or not for this caller."""


class Conflict(DomainError):
    """The request is right in itself, but not in the present state."""


class Rejected(DomainError):
    """The input is wrong, and will be wrong the next time too."""


class Unfulfilled(DomainError):
    """The work was done and its result is not good enough."""


class Unavailable(DomainError):
    """Not now; the same call may succeed later."""


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


class MapNotFound(NotFound):
    """No map with this id exists, or the key does not cover it."""

    title = "No such map"


class DrawingNotFound(NotFound):
    """No drawing with this id exists, or the key does not cover its map."""

    title = "No such drawing"


class ScanNotFound(NotFound):
    """No scan with this id exists, or the key does not cover its map."""

    title = "No such scan"


class PlacementNotFound(NotFound):
    """No placement with this id exists, or the key does not cover its map."""

    title = "No such placement"


class LayerNotFound(NotFound):
    """The revision that is changed has no layer of this id; `detail` lists those that it has."""

    title = "No such layer"


class RegionNotFound(NotFound):
    """The revision that is changed has no erased region of this id; `detail` lists those that it has."""

    title = "No such erased region"


class ProposalNotFound(NotFound):
    """No proposal with this id exists, or the key does not cover its map."""

    title = "No such proposal"


class RevisionNotFound(NotFound):
    """The map has no revision of this number."""

    title = "No such revision"


class ArtifactNotFound(NotFound):
    """The revision, drawing or scan has no file of this name."""

    title = "No such file"


class RobotNotFound(NotFound):
    """No robot with this id exists, or the key does not cover its map."""

    title = "No such robot"


class RolloutNotFound(NotFound):
    """No roll-out with this id exists, or the key does not cover its map."""

    title = "No such roll-out"


class JobNotFound(NotFound):
    """No job with this id exists, or the key does not cover its map."""

    title = "No such job"


class WebhookNotFound(NotFound):
    """No webhook with this id exists, or it hears of maps that the key does not cover."""

    title = "No such webhook"


class KeyNotFound(NotFound):
    """No API key with this id exists."""

    title = "No such key"


class UploadNotFound(NotFound):
    """No upload in pieces has this id, or another key began it."""

    title = "No such upload"


class UploadExpired(NotFound):
    """The upload in pieces was not finished in time, and what had come of it is gone.

    Begin it again by `POST /v1/tus`; `Upload-Expires` tells how long it may take.
    """

    title = "The upload has expired"


class NothingPublished(NotFound):
    """The map has no revision published on this channel yet."""

    title = "Nothing is published on this channel"


class RevisionNotReady(Conflict):
    """The revision is still building, or its build failed: it cannot be downloaded, published or built on.

    `status` tells which. Wait for its job, or look at the job's problem.
    """

    title = "The revision is not ready"


class DrawingNotRead(Conflict):
    """The drawing has no finished reading: its job still runs, or it failed.

    Wait for the job that `job_id` names, or look at its problem.
    """

    title = "The drawing has not been read"


class ScanNotRead(Conflict):
    """The scan has no finished reading: its job still runs, or it failed.

    Wait for the job that `job_id` names, or look at its problem.
    """

    title = "The scan has not been read"


class MapNameTaken(Conflict):
    """The site already has a map of this name."""

    title = "The name is taken"


class StaleBase(Conflict):
    """Somebody changed the same things since the base revision that the request builds on.

    Changes of other things are put together without asking; these are not. `latest` names the newest
    revision, `theirs` what changed up to it since `base`, `yours` what the request would change of it,
    each with the value `before` and `after`; `overlap` names what both are about: look at it, then ask again
    with the latest revision as the base.
    """

    title = "The same things were changed by somebody else"


class GatesClosed(Conflict):
    """The revision may not be published yet; `gates` lists what stands against it.

    Settle it (place the scan anew, correct the drawing), or publish with `override`, whose `reason` is kept
    in the history under your key's name.
    """

    title = "The revision does not pass the gates"


class ProposalDecided(Conflict):
    """Somebody has accepted or dismissed the proposal already; `state` tells which."""

    title = "The proposal is decided"


class RebuiltDifferently(Unfulfilled):
    """The revision was built again from its inputs, and some files have other bytes than they had.

    `paths` names them. The recorded files stay as they are; `built_with` and `rebuilt_with` are the versions
    of the software that made them.
    """

    title = "The revision was rebuilt differently"


class RevisionPruned(Conflict):
    """The revision's files were let go to make room; what it is made of is kept.

    `POST /v1/maps/{map_id}/revisions/{n}/rebuild` makes the same files again.
    """

    title = "The revision's files were let go"


class DeltaNotOffered(Conflict):
    """Nobody made this delta yet, and for this key none is made that leads elsewhere than robots are to go.

    Made for any key are deltas into a revision that a channel points to, or that a roll-out gives the robot
    whose own key asks; for an admin's key those into any revision. Take the changed tiles or the whole file.
    """

    title = "The delta is not made for this key"


class PlacementNotAcceptable(Conflict):
    """The placement is not finished, was rejected, or needs a review that the request does not confirm.

    A placement with the verdict `needs-review` is accepted only with `"reviewed": true` in the body,
    by a person who has looked at it.
    """

    title = "The placement cannot be accepted"


class UploadBusy(Conflict):
    """Another request is writing to the same upload in pieces.

    A connection that broke holds its upload for some seconds: wait for `retry_after_s`, ask for the offset
    by `HEAD`, and go on from there.
    """

    title = "The upload is being written to"


class UploadOffsetMismatch(Conflict):
    """The piece does not begin where the stored bytes end; `upload_offset` tells where that is."""

    title = "The piece begins at another offset"


class PointerMoved(Conflict):
    """The published revision has changed since the caller looked (`If-Match` does not hold).

    Read `GET /v1/maps/{map_id}/published` again and decide anew.
    """

    title = "The published revision has changed"


class FileIsAnother(Conflict):
    """The file is not the one that `If-Match` names; `etag` is what it has now.

    Ask again without `If-Match`, and for all of it: parts of the other file do not go with this one.
    """

    title = "The file is another one"


class RolloutUnderWay(Conflict):
    """The channel has a roll-out that has not ended: until then it decides what the robots have.

    `rollout_id` names it. Wait for its end, or end it by `POST /v1/rollouts/{id}/abort`.
    """

    title = "A roll-out is under way"


class RolloutNotInState(Conflict):
    """The roll-out's present `state` does not allow this: one that has ended stays as it is."""

    title = "The roll-out's state does not allow this"


class VehicleTaken(Conflict):
    """Another robot has this manufacturer and serial number already: they name one vehicle on the broker."""

    title = "The vehicle is enrolled already"


class LastAdminKey(Conflict):
    """No other admin key of all maps is valid for as long as this one: without it, nobody could make keys.

    Make another by `POST /v1/keys` with the role `admin`, no `map_ids`, and no earlier `expires_at`; then
    revoke this one with it. Where every admin key is lost, `groundplan key create --role admin` makes one on
    the server.
    """

    title = "The last admin key cannot be revoked"


class JobNotCancellable(Conflict):
    """The job has already ended."""

    title = "The job has already ended"


class JobNotRetryable(Conflict):
    """Only a job that failed or was cancelled can be tried again."""

    title = "The job cannot be tried again"


class InvalidRequest(Rejected):
    """The body, a field, a header or a query parameter is not what the API asks for.

    `errors` lists each place as a JSON pointer with a sentence.
    """

    title = "The request is not valid"


class UnsupportedMedia(Rejected):
    """The file's own bytes are of no kind that is read here, whatever its name says."""

    title = "This kind of file is not read"


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


class FileEmpty(Rejected):
    """The file has no bytes, or holds no point or pixel."""

    title = "The file is empty"


class FileTruncated(Rejected):
    """The file ends before its own header says it should: the copy or the upload was cut short."""

    title = "The file is cut short"


class FileMalformed(Rejected):
    """The file breaks the rules of its own format; `detail` tells where."""

    title = "The file cannot be read"


class HeaderMismatch(Rejected):
    """The file's header promises something else than its bytes hold."""

    title = "The file's header contradicts its bytes"


class NotFinite(Rejected):
    """The file holds coordinates that are not finite numbers (NaN or infinity)."""

    title = "The file holds values that are not numbers"


class ImageTooLarge(Rejected):
    """The image has more pixels than are read; `max_pixels` tells how many are."""

    title = "The image is too large"


class TooManyPoints(Rejected):
    """The point cloud has more points than are read; `max_points` tells how many are."""

    title = "The point cloud is too large"


class CoordinatesTooLarge(Rejected):
    """The map lies so far from its origin, or the scan reaches so far, that float32 cannot tell voxels apart.

    Of a map, choose a `T_map_drawing` nearer to the origin, or a larger voxel size. Of a scan, give the unit
    of its file, or cut off what lies far away; coordinates that no place on Earth has tell of a damaged file.
    """

    title = "The coordinates are too large"


class ScaleUnknown(Rejected):
    """The drawing's scale is not known, so no map in metres can be made from it.

    Give metres per pixel, a ratio with its dpi, or a known length.
    """

    title = "The scale of the drawing is unknown"


class PageNotFound(Rejected):
    """The document has no page of this number, or has several and none was named."""

    title = "No such page"


class PageNeeded(Rejected):
    """The document has several pages, and none was chosen.

    `pages` lists them with their sizes: ask again with the page that shows the floor plan, counted from 1.
    """

    title = "A page has to be chosen"


class FileEncrypted(Rejected):
    """The document opens only with a password, which is never asked for here.

    Save it without a password (print it to a new PDF) and upload that.
    """

    title = "The document is encrypted"


class DrawingTooComplex(Rejected):
    """The drawing holds more strokes, texts or nested parts than are read.

    Export the one floor that is needed, or print the sheet as a PNG image.
    """

    title = "The drawing is too complex"


class ReadingTooCostly(Rejected):
    """Reading the file took more CPU, memory or time than a file that promises so much may take.

    It was stopped. `limit` tells at which limit (`cpu`, `memory` or `wall`); `cpu_limit_s`,
    `memory_limit_bytes` and `wall_limit_s` how much it may take; `cpu_used_s`, `memory_used_bytes` and
    `wall_used_s` how much it had taken; `points`, `pixels` and `cad_bytes` what the file promises by its
    header and its size. Export what is needed of it: one floor, fewer points, a lower resolution. A file that
    is small and costs so much is damaged, or was made to do harm.
    """

    title = "Reading the file costs too much"


class NoWallsFound(Unfulfilled):
    """Nothing on the drawing was recognised as a wall."""

    title = "No walls were found"


class ReaderCrashed(Rejected):
    """The program that reads this kind of file crashed on it: the file is damaged, or breaks the format.

    Open it in the program that made it, repair it, and export it again. `signal` tells how the reader ended.
    """

    title = "The file crashes its reader"


class NotADrawing(Unfulfilled):
    """The picture has continuous tones, as a photo has: it is no drawing that walls could be read from.

    Scan the drawing, or photograph it so that the sheet fills the picture. `paper` is the share that is as
    bright as bare paper, `tones` the share that lies in the midst of middle tones.
    """

    title = "The picture is not a drawing"


class PlacementNotComputed(Unfulfilled):
    """No placement could be computed: the scan and the map share too little to compare."""

    title = "No placement could be computed"


class JobCrashed(Unfulfilled):
    """The work on the job came to no end: a defect ended it, or its process died in each of three tries.

    Nothing was changed, and the file that the job works on is kept. `attempts` counts the tries, `last` tells
    how the last one ended. Retry the job once; if it ends so again, the worker's log tells the cause under
    the job's id: send it to those who look after the installation.
    """

    title = "The job crashed"


class JobTimedOut(Unfulfilled):
    """The job took longer than a job may, and was stopped.

    `limit` tells at which limit: `cpu` seconds (`cpu_used_s` of `cpu_limit_s`) or seconds of the `wall` clock
    (`wall_used_s` of `wall_limit_s`). Ask for less at a time, or let the operator raise
    `GROUNDPLAN_JOB_CPU_S` or `GROUNDPLAN_JOB_WALL_S`.
    """

    title = "The job took too long"


class JobOutOfMemory(Unfulfilled):
    """The job needed more memory than a job may take, and was stopped.

    `memory_used_bytes` tells what it held, `memory_limit_bytes` what it may. Ask for less at a time, or let
    the operator raise `GROUNDPLAN_JOB_MEMORY_BYTES`.
    """

    title = "The job needed too much memory"


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


class DeltaNotReady(Unavailable):
    """The delta between the two revisions is being made, or could not be made; `job_id` names its job.

    Ask again after the `Retry-After` seconds. Who cannot wait takes the changed tiles or the whole file.
    """

    title = "The delta is not ready"


class TooManyDeltas(Unavailable):
    """So many deltas of the map have still to be made that no other is begun.

    `max_waiting_deltas` tells how many may wait. Take the changed tiles or the whole file, or ask again after
    the `Retry-After` seconds. Deltas that are made already are given all the while.
    """

    title = "Too many deltas of the map have still to be made"


class ExportNotReady(Unavailable):
    """The export is being made, or could not be made; `job_id` names its job.

    Ask again after the `Retry-After` seconds, or look at the job's problem.
    """

    title = "The export is not ready"


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
