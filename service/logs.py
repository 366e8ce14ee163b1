"""Logs: for people on a terminal, one JSON object per line otherwise."""

from __future__ import annotations

import logging
import sys

import structlog
from asgi_correlation_id import correlation_id
from structlog.typing import EventDict, Processor

_QUIET = {
    "alembic": logging.WARNING,
    "procrastinate": logging.WARNING,
    "procrastinate.worker": logging.ERROR,
    "psycopg.pool": logging.ERROR,
    "uvicorn.access": logging.WARNING,
    "asyncio": logging.ERROR,
}


def configure(level: str) -> None:
    """Send every logger's lines to standard error, ``level`` and above."""
    shared: list[Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        _add_trace_id,
    ]
    # Tracebacks without local variables: those hold keys, documents and whole arrays.
    traced = structlog.processors.ExceptionRenderer(
        structlog.tracebacks.ExceptionDictTransformer(show_locals=False)
    )
    last: list[Processor] = (
        [structlog.dev.ConsoleRenderer(exception_formatter=structlog.dev.plain_traceback)]
        if sys.stderr.isatty()
        else [traced, structlog.processors.JSONRenderer()]
    )
    structlog.configure(
        processors=[*shared, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=True,
    )
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *last],
        )
    )
    logging.basicConfig(handlers=[handler], level=level.upper(), force=True)
    for name, quiet in _QUIET.items():
        logging.getLogger(name).setLevel(quiet)


def _add_trace_id(_logger: object, _method: str, event: EventDict) -> EventDict:
    """The id of the request, where there is one: the ``trace_id`` of its problem answer."""
    trace_id = correlation_id.get()
    if trace_id is not None:
        event["trace_id"] = trace_id
    return event
