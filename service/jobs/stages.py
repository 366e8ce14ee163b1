"""The engine's stages as a job reports them: seconds, progress, and what was kept from before."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

from service.jobs.cache import StageCache
from service.jobtypes import Report

Value = TypeVar("Value")

NAMES = (
    "read",
    "topology",
    "parameterization",
    "registration",
    "correspondence",
    "control_points",
    "iteration",
    "restoration",
    "measures",
    "write",
)
KEPT = frozenset(
    {
        "topology",
        "parameterization",
        "registration",
        "correspondence",
        "iteration",
        "restoration",
        "measures",
    }
)
_EVERY_TIME = frozenset({"iteration", "restoration", "measures", "write"})
"""What every edit has a part of that is its own, also one that starts from an open one."""


class JobStages:
    """Runs the pipeline's work; a stage is ``cached`` when all that it keeps was kept before."""

    def __init__(self, report: Report, cache: StageCache) -> None:
        self._report = report
        self._cache = cache
        self._asked: set[str] = set()
        self._stages: dict[str, dict[str, Any]] = {
            name: {
                "name": name,
                "status": "pending",
                "progress": 0.0,
                "seconds": 0.0,
                "cached": False,
            }
            for name in NAMES
        }

    def run(self, name: str, key: str, work: Callable[[], Value]) -> Value:
        """Do one piece of a stage, or take it from the cache; a piece of a piece counts once."""
        stage = self._stages[name]
        if stage["status"] == "pending":
            stage["status"] = "running"
            self._tell(stage)
        start, before = time.perf_counter(), stage["seconds"]
        value = self._kept_or_done(stage, key, work) if key and name in KEPT else work()
        stage["seconds"] = before + time.perf_counter() - start
        return value

    def _kept_or_done(self, stage: dict[str, Any], key: str, work: Callable[[], Value]) -> Value:
        name, value = stage["name"], self._cache.get(stage["name"], key)
        kept = value is not None
        if not kept:
            value = work()
            self._cache.put(name, key, value)
        stage["cached"] = kept and (stage["cached"] or name not in self._asked)
        self._asked.add(name)
        return value

    def again(self, report: Report) -> None:
        """For an edit that starts from one that is open: what that one did is kept for it."""
        self._report = report
        for name, stage in self._stages.items():
            stage["seconds"] = 0.0
            if name in _EVERY_TIME:
                kept = name in self._asked
                stage.update(status="pending", progress=0.0, cached=kept)
            elif stage["status"] == "done":
                stage["cached"] = True
                self._tell(stage)

    def progress(self, name: str, fraction: float) -> None:
        """Say how much of a stage is done."""
        stage = self._stages[name]
        stage["progress"] = round(fraction, 4)
        if fraction < 1.0:
            self._tell(stage)
        else:
            self.finish(name)

    def iterations(self, name: str, count: int, residual: float) -> None:
        """Say how many iterations a stage took in all and where the last ended."""
        stage = self._stages[name]
        stage["iterations"] = stage.get("iterations", 0) + count
        stage["residual"] = residual

    def finish(self, name: str) -> None:
        """A stage is over."""
        stage = self._stages[name]
        if stage["status"] != "done":
            stage["status"], stage["progress"] = "done", 1.0
            self._tell(stage)

    def finish_all(self) -> None:
        """Everything is over."""
        for stage in self._stages.values():
            if stage["status"] != "pending":
                stage["status"], stage["progress"] = "done", 1.0
                self._tell(stage)

    def list(self) -> list[dict[str, Any]]:
        """The stages so far, in the engine's order; those that had nothing to do are left out."""
        begun = [stage for stage in self._stages.values() if stage["status"] != "pending"]
        return [dict(stage, seconds=round(stage["seconds"], 6)) for stage in begun]

    def _tell(self, stage: dict[str, Any]) -> None:
        self._report({"type": "stage", **stage, "seconds": round(stage["seconds"], 6)})
