"""Robots, roll-outs, webhooks, and what is made for robots on request."""

from __future__ import annotations

from service.domain.errors.tree import Conflict, NotFound, Unavailable


class RobotNotFound(NotFound):
    """No robot with this id exists, or the key does not cover its map."""

    title = "No such robot"


class RolloutNotFound(NotFound):
    """No roll-out with this id exists, or the key does not cover its map."""

    title = "No such roll-out"


class WebhookNotFound(NotFound):
    """No webhook with this id exists, or it hears of maps that the key does not cover."""

    title = "No such webhook"


class DeltaNotOffered(Conflict):
    """Nobody made this delta yet, and for this key none is made that leads elsewhere than robots are to go.

    Made for any key are deltas into a revision that a channel points to, or that a roll-out gives the robot
    whose own key asks; for an admin's key those into any revision. Take the changed tiles or the whole file.
    """

    title = "The delta is not made for this key"


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
