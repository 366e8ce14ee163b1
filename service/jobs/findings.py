"""What is found in a mesh file: the same for its resource, a validation and an edit's report."""

from __future__ import annotations

from engine.io import MeshFile
from engine.pipeline import normalisation
from engine.types import MeshWarning
from service.jobtypes import Json

_UNITS = ((0.03, 3.0, "m"), (3.0, 200.0, "cm"), (200.0, 3e3, "mm"), (3e4, 3e6, "µm"))
"""Bounding-box diagonals that name a unit: a face has some 20 to 50 cm, a whole figure 200."""


def unit_guess(file: MeshFile) -> str:
    """The unit in which a face would have this size, ``unknown`` where it would in none."""
    _, diagonal = normalisation(file.mesh)
    return next((unit for low, high, unit in _UNITS if low < diagonal <= high), "unknown")


def warning_documents(file: MeshFile, found: tuple[MeshWarning, ...]) -> list[Json]:
    """The reader's warnings and those ``found`` in the surface, each matter once."""
    known = {warning.code for warning in file.warnings}
    warnings = (*file.warnings, *(warning for warning in found if warning.code not in known))
    return [
        {
            "code": warning.code,
            "message": warning.message,
            "elements": warning.elements,
            "count": warning.count,
            "first": list(warning.first),
        }
        for warning in warnings
    ]
