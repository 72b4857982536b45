"""Requests of tests that hold no client: as `httpx`, whose five seconds a loaded machine may need."""

from __future__ import annotations

from functools import partial

import httpx

from tests.patience import PATIENCE_S

get, head = partial(httpx.get, timeout=PATIENCE_S), partial(httpx.head, timeout=PATIENCE_S)
post, put = partial(httpx.post, timeout=PATIENCE_S), partial(httpx.put, timeout=PATIENCE_S)
patch, delete = partial(httpx.patch, timeout=PATIENCE_S), partial(httpx.delete, timeout=PATIENCE_S)
request, stream = partial(httpx.request, timeout=PATIENCE_S), partial(httpx.stream, timeout=PATIENCE_S)
options = partial(httpx.options, timeout=PATIENCE_S)
Client = partial(httpx.Client, timeout=PATIENCE_S)
