"""Webhooks: which events there are, how a delivery is signed (Standard Webhooks), when it is tried again."""

from __future__ import annotations

import base64
import hmac
from collections.abc import Sequence
from enum import StrEnum

SECRET_BYTES = 32
_PREFIX = "whsec_"

BACK_OFF_S = (5.0, 30.0, 120.0, 600.0, 3600.0, 3 * 3600.0, 6 * 3600.0, 12 * 3600.0)
"""Seconds from each try that failed to the next."""

MAX_TRIES = len(BACK_OFF_S) + 1


class EventKind(StrEnum):
    """What a webhook can be told of."""

    REVISION_READY = "revision.ready"
    REVISION_PUBLISHED = "revision.published"
    PLACEMENT_JUDGED = "placement.judged"
    JOB_FAILED = "job.failed"
    ROBOT_FAILED = "robot.failed"
    ROLLOUT_STOPPED = "rollout.stopped"
    ROLLOUT_FINISHED = "rollout.finished"


class DeliveryState(StrEnum):
    """Where a delivery stands; ``delivered`` and ``failed`` are final."""

    PENDING = "pending"
    DELIVERED = "delivered"
    FAILED = "failed"


def back_off_s(failures: int) -> float:
    """Return the seconds to wait after so many failures in a row, at least one."""
    return BACK_OFF_S[min(failures, len(BACK_OFF_S)) - 1]


def new_secret(random: bytes) -> str:
    """Return a secret as Standard Webhooks writes it: ``whsec_`` and base64."""
    return _PREFIX + base64.b64encode(random).decode()


def signature(secrets: Sequence[str], *, message_id: str, timestamp: int, body: bytes) -> str:
    """Return the header ``webhook-signature``: HMAC-SHA-256 of id, time and body under each secret.

    Notes
    -----
    Standard Webhooks 1.0.0, "Signature scheme": several signatures stand side by side while a secret is
    replaced; whoever knows one of the secrets finds its own.
    """
    signed = f"{message_id}.{timestamp}.".encode() + body
    keys = [base64.b64decode(secret.removeprefix(_PREFIX)) for secret in secrets]
    return " ".join("v1," + base64.b64encode(hmac.digest(key, signed, "sha256")).decode() for key in keys)
