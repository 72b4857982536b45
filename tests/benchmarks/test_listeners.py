"""What a thousand open event streams cost a service process, and how soon a revoked key's streams end."""

from __future__ import annotations

import asyncio
import statistics
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import psutil
import pytest

from service.settings import Settings
from tests.server import Server, running, start
from tests.service.asking import a_map, a_ready_revision, ok
from tests.service.by_hand import ByHand

pytestmark = pytest.mark.benchmark

LISTENERS = 1_000
KEYS = 20
SECONDS = 30.0
ASKS = 500
ROUNDS = 5
MOST_SHARE = 0.05
MOST_RATIO = 1.2
ENDED_WITHIN_S = 5.0
"""What is promised of a thousand listeners: share of a core, slowing of others, end of a revoked key."""


class Stream:
    """One open stream on a bare socket: counts its bytes, and remembers when it ended."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.ended_at: float | None = None
        self.heard = b""
        self._writer = writer
        self._task = asyncio.create_task(self._read(reader))

    async def _read(self, reader: asyncio.StreamReader) -> None:
        while got := await reader.read(65536):
            self.heard = (self.heard + got)[-400:]
            if self.heard.endswith(b"0\r\n\r\n"):
                break
        self.ended_at = time.monotonic()

    async def close(self) -> None:
        """Hang up."""
        self._writer.close()
        await self._task


async def _listen(server: Server, key: str) -> Stream:
    address = urlsplit(server.url)
    reader, writer = await asyncio.open_connection(address.hostname, address.port)
    ask = f"GET /v1/events HTTP/1.1\r\nHost: {address.netloc}\r\nAuthorization: Bearer {key}\r\n\r\n"
    writer.write(ask.encode())
    head = await reader.readuntil(b"retry: 1000\n\n")
    assert head.startswith(b"HTTP/1.1 200 "), head
    return Stream(reader, writer)


async def _p95_ms(*clients: httpx.AsyncClient) -> list[float]:
    """Return the 95th percentiles of the times that services take, each asked in turn, one at a time."""
    took: list[list[float]] = [[] for _ in clients]
    for _ in range(ASKS):
        for client, times in zip(clients, took, strict=True):
            begun = time.perf_counter()
            answer = await client.get("/v1/maps")
            times.append((time.perf_counter() - begun) * 1000)
            assert answer.status_code == 200
    return [statistics.quantiles(times, n=20)[-1] for times in took]


async def _share(server: Server) -> float:
    """Return which share of a core the service's process takes while nobody asks anything."""
    process = psutil.Process(server.process.pid)
    before, begun = process.cpu_times(), time.monotonic()
    await asyncio.sleep(SECONDS)
    after = process.cpu_times()
    return (after.user + after.system - before.user - before.system) / (time.monotonic() - begun)


async def _until(holds: Callable[[], bool]) -> float:
    begun = time.monotonic()
    async with asyncio.timeout(60):
        while not holds():  # noqa: ASYNC110 - what other tasks have read
            await asyncio.sleep(0.01)
    return time.monotonic() - begun


def _shown(pair: list[float]) -> str:
    return " : ".join(f"{ms:.1f}" for ms in pair)


async def _measured(one: Server, two: Server, publish: Callable[[], Awaitable[None]]) -> None:
    headers = {"Authorization": f"Bearer {one.admin_key}"}
    async with (
        httpx.AsyncClient(base_url=one.url, headers=headers, timeout=60) as client,
        httpx.AsyncClient(base_url=two.url, headers=headers, timeout=60) as elsewhere,
    ):
        keys = [
            (await client.post("/v1/keys", json={"name": f"{n}", "role": "tablet"})).json()
            for n in range(KEYS)
        ]
        await _p95_ms(client, elsewhere)
        alone_share, before = await _share(one), await _p95_ms(client, elsewhere)
        begun, streams = time.monotonic(), list[Stream]()
        for n in range(0, LISTENERS, KEYS):
            streams += await asyncio.gather(*(_listen(one, keys[k]["key"]) for k in range(KEYS)))
            del n
        opened_s = time.monotonic() - begun
        with_share = await _share(one)
        rounds = [await _p95_ms(client, elsewhere) for _ in range(ROUNDS)]
        rss = one.rss_bytes / 2**20
        await publish()
        told_s = await _until(lambda: all(b"event: publication" in each.heard for each in streams))
        await elsewhere.delete(f"/v1/keys/{keys[0]['id']}")
        theirs = streams[::KEYS]
        ended_s = await _until(lambda: all(each.ended_at for each in theirs))
        alive = sum(each.ended_at is None for each in streams)
        await asyncio.gather(*(each.close() for each in streams))
    ratios = [with_all / with_none for with_all, with_none in rounds]
    print(
        f"\n{one.kernel.db.engine.dialect.name}: {len(streams)} listeners, opened in {opened_s:.1f} s,"
        f" {rss:.0f} MiB"
        f"\n  share of a core: {alone_share:.2%} with none, {with_share:.2%} with all"
        f"\n  p95 of GET /v1/maps, this process and one without listeners asked in turn [ms]:"
        f" {_shown(before)} before; {', '.join(map(_shown, rounds))} with all:"
        f" {statistics.median(ratios):.2f} x"
        f"\n  an event reached all within {told_s:.2f} s; a key revoked in another process: its {len(theirs)}"
        f" streams ended within {ended_s:.2f} s, {alive} others go on"
    )
    assert len(streams) == LISTENERS
    assert alive == LISTENERS - len(theirs)
    assert with_share < MOST_SHARE
    assert statistics.median(ratios) <= MOST_RATIO
    assert ended_s <= ENDED_WITHIN_S


def _compare(settings: Settings) -> None:
    with running(settings) as one:
        two = start(settings, admin_key=one.admin_key)
        try:
            admin = two.client(one.admin_key)
            map_id = a_map(admin)
            a_ready_revision(admin, ByHand(one.kernel), map_id)

            async def publish() -> None:
                await asyncio.to_thread(
                    lambda: ok(admin.post(f"/v1/maps/{map_id}/revisions/1/publish", json={}))
                )

            asyncio.run(_measured(one, two, publish))
        finally:
            two.close()


def test_a_thousand_listeners_on_sqlite(tmp_path: Path) -> None:
    _compare(Settings(data_dir=tmp_path / "data"))


@pytest.mark.postgres
def test_a_thousand_listeners_on_postgresql(postgres_url: str, tmp_path: Path) -> None:
    _compare(Settings(data_dir=tmp_path / "data", database_url=postgres_url))
