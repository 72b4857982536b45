"""Maps, their drawings, scans, placements and revisions."""

from __future__ import annotations

from service.domain.errors.tree import Conflict, NotFound


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


class RevisionPruned(Conflict):
    """The revision's files were let go to make room; what it is made of is kept.

    `POST /v1/maps/{map_id}/revisions/{n}/rebuild` makes the same files again.
    """

    title = "The revision's files were let go"


class PlacementNotAcceptable(Conflict):
    """The placement is not finished, was rejected, or needs a review that the request does not confirm.

    A placement with the verdict `needs-review` is accepted only with `"reviewed": true` in the body,
    by a person who has looked at it.
    """

    title = "The placement cannot be accepted"


class PointerMoved(Conflict):
    """The published revision has changed since the caller looked (`If-Match` does not hold).

    Read `GET /v1/maps/{map_id}/published` again and decide anew.
    """

    title = "The published revision has changed"
