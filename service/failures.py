"""Why an edit failed, as the problem that is kept with it."""

from __future__ import annotations

from service.domain import Json
from service.errors import CrashError, problem_of, refusal_of
from service.runner import Outcome
from service.schemas import ProblemError


def failure_of(outcome: Outcome) -> Json:
    """The problem of an attempt that gave no result."""
    if outcome.ending == "crashed":
        return _crash(
            "worker_crashed", f"The process that computed this edit broke: {outcome.detail}"
        )
    return problem_of(refusal_of(outcome)).model_dump(mode="json")


def refusal(error: Exception) -> Json:
    """The problem of an exception in the table of ``service.errors``."""
    return problem_of(error).model_dump(mode="json")


def attempts_exhausted() -> Json:
    """The problem of an edit that lost its worker in every attempt."""
    return _crash("attempts_exhausted", "The process that ran this edit was lost in every attempt.")


def _crash(code: str, message: str) -> Json:
    error = ProblemError(code=code, message=message)
    return problem_of(CrashError(message, errors=[error])).model_dump(mode="json")
