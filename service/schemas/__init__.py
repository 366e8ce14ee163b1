"""The wire models: what clients send and what the service answers."""

from service.schemas.addresses import Address, Place
from service.schemas.edits import ControlPoint, EditDocument, Options
from service.schemas.parsing import InvalidDocumentError, MalformedJsonError, parse
from service.schemas.problems import Element, Problem, ProblemError
from service.schemas.rules import broken_rules

__all__ = [
    "Address",
    "ControlPoint",
    "EditDocument",
    "Element",
    "InvalidDocumentError",
    "MalformedJsonError",
    "Options",
    "Place",
    "Problem",
    "ProblemError",
    "broken_rules",
    "parse",
]
