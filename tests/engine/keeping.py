"""Stages whose results are kept, so that tests do not register the same faces again and again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from engine.pipeline import Stopwatch


@dataclass(slots=True)
class Keeping(Stopwatch):
    kept: dict[tuple[str, str], Any] = field(default_factory=dict[tuple[str, str], Any])

    def run(self, name: str, key: str, work: Callable[[], Any]) -> Any:
        if not key:
            return work()
        if (name, key) not in self.kept:
            self.kept[name, key] = work()
        return self.kept[name, key]


KEEPING = Keeping()
"""For tests of the bundled faces."""
