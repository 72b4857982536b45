"""A service without a worker that has one row of every kind, so that every list has something to show."""

from __future__ import annotations

from service.db.webhooks import WebhookDelivery
from tests.server import Server
from tests.service.asking import a_map, a_placement, a_ready_revision, ok
from tests.service.by_hand import ByHand


def one_of_each(server: Server) -> None:
    """Make a map with one row of every kind, whose jobs have ended."""
    admin, by_hand = server.client(server.admin_key), ByHand(server.kernel)
    map_id = a_map(admin)
    by_hand.drawing(map_id)
    by_hand.scan(map_id)
    a_ready_revision(admin, by_hand, map_id)
    placement_id = a_placement(admin, by_hand, map_id)
    revised = admin.post(f"/v1/placements/{placement_id}/accept", json={})
    by_hand.build(ok(revised, 202)["job"]["id"])
    ok(admin.post(f"/v1/maps/{map_id}/revisions/1/publish", json={"reason": "told"}))
    robot = ok(admin.post("/v1/robots", json={"name": "AMR", "map_id": map_id}), 201)
    said = {"state": "failed", "revision": 1, "detail": "told"}
    ok(server.client(robot["key"]).post(f"/v1/robots/{robot['id']}/reports", json=said), 201)
    stages = {"revision": 2, "stages": [{"share": 1.0}]}
    ok(admin.post(f"/v1/maps/{map_id}/rollouts", json=stages), 201)
    hook = {"url": "https://example.com/hook", "events": ["job.failed"]}
    webhook = ok(admin.post("/v1/webhooks", json=hook), 201)
    _deliver(server, map_id, webhook["id"])
    failed = by_hand.drawing(map_id, read=False)
    job = ok(admin.get(f"/v1/drawings/{failed}"))["job"]["id"]
    by_hand.fail(job, problem={"slug": "file-malformed", "title": "t", "detail": "d"})


def _deliver(server: Server, map_id: str, webhook_id: str) -> None:
    kernel = server.kernel
    with kernel.db.writing("dispatch-webhooks") as session:
        now = kernel.now()
        session.add(
            WebhookDelivery(
                id=kernel.new_id("del"),
                webhook_id=webhook_id,
                map_id=map_id,
                event="job.failed",
                body="{}",
                state="failed",
                tries=[],
                try_at=now,
                created_at=now,
                ended_at=now,
            )
        )
