"""Waiting for edits without holding up a thread."""

from __future__ import annotations

import time

from anyio import to_thread

from service.dependencies import Service
from service.domain import EditRecord

SLICE = 1.0
"""Seconds after which a wait looks whether the process is about to end."""


async def changed(service: Service, edit: EditRecord, seq: int, seconds: float) -> EditRecord:
    """The edit once it is finished or has events after ``seq``, or as it is after ``seconds``."""
    deadline = time.monotonic() + seconds
    with service.records.watch(edit.id) as watch:
        stale = True
        while not edit.finished and edit.last_seq <= seq:
            if stale:
                edit = await to_thread.run_sync(service.records.get_edit, edit.id)
                stale = False
                continue
            left = deadline - time.monotonic()
            if left <= 0 or service.draining.is_set():
                break
            stale = await watch.wait_async(min(left, SLICE))
    return edit


async def finished(service: Service, edit: EditRecord, seconds: float) -> EditRecord:
    """The edit once it is finished, or as it is after ``seconds``."""
    deadline = time.monotonic() + seconds
    while not edit.finished and not service.draining.is_set():
        left = deadline - time.monotonic()
        if left <= 0:
            break
        edit = await changed(service, edit, edit.last_seq, left)
    return edit
