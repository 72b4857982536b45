"""Logs of both processes: one event a line, as JSON or for a terminal, with what is bound to the request."""

from __future__ import annotations

import logging
import sys
from typing import Any

import structlog

_exceptions = structlog.processors.ExceptionRenderer(
    structlog.tracebacks.ExceptionDictTransformer(show_locals=False)
)
_SECRET_FIELDS = frozenset({"authorization", "secret", "database_url", "token", "password"})


def configure(*, level: str, as_json: bool | None = None) -> None:
    """Send the logs of this process to stderr, those of libraries included.

    Parameters
    ----------
    level : str
        debug, info, warning or error.
    as_json : bool, optional
        By default JSON, unless stderr is a terminal.

    Raises
    ------
    ValueError
        If the level has another name.

    Notes
    -----
    A trace is told without the values of variables: among those of a request is the key presented with
    it, among those of a delivery the secret that signs it. What SQL was given is hidden by the engine
    (`service.db.session.open_engine`).
    """
    number = logging.getLevelNamesMapping().get(level.upper())
    if number is None:
        msg = f"the log level {level!r} is not one of debug, info, warning, error"
        raise ValueError(msg)
    shared: list[Any] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_logger_name,
        structlog.stdlib.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        _without_secrets,
    ]
    plain = as_json if as_json is not None else not sys.stderr.isatty()
    renderer: list[Any] = (
        [_exceptions, structlog.processors.JSONRenderer()]
        if plain
        else [structlog.dev.ConsoleRenderer(colors=False, exception_formatter=structlog.dev.plain_traceback)]
    )
    structlog.configure(
        processors=[*shared, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.make_filtering_bound_logger(number),
        cache_logger_on_first_use=False,
    )
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *renderer],
        )
    )
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(number)
    for chatty in ("alembic", "procrastinate", "asyncio"):
        logging.getLogger(chatty).setLevel(max(number, logging.WARNING))


def _without_secrets(_logger: Any, _method: str, event: Any) -> Any:
    for name in _SECRET_FIELDS & event.keys():
        event[name] = "(hidden)"
    return event
