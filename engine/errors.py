"""Everything the engine refuses, each with the offending elements and what would help.

An error's ``str`` is one sentence or two for a person: what is wrong, where, what would help.
``code`` is stable and machine-readable; ``elements`` holds the offending things (vertex or face
indices, byte offsets, loop lengths, limits) as plain numbers, strings and lists of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

Element = int | float | str | list[int] | list[float] | list[str]


class EngineError(Exception):
    """Base of all refusals. Subclasses name the stage, ``code`` names the reason."""

    default_code: ClassVar[str] = "engine_error"

    def __init__(
        self,
        message: str,
        *,
        code: str | None = None,
        elements: Mapping[str, Element] | None = None,
    ) -> None:
        super().__init__(message)
        self.code = code or self.default_code
        self.elements: dict[str, Element] = dict(elements or {})

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (type(self), str(self), self.code, self.elements)


def _rebuild(
    cls: type[EngineError], message: str, code: str, elements: Mapping[str, Element]
) -> EngineError:
    return cls(message, code=code, elements=elements)


class MeshFormatError(EngineError):
    """The bytes are not a PLY or OBJ file that can be read: says at which line or byte."""

    default_code = "mesh_format"


class UnsupportedFormatError(MeshFormatError):
    """The bytes are of another format altogether."""

    default_code = "unsupported_format"


class TopologyError(EngineError):
    """The mesh has no editable surface: says which faces, edges or loops prevent it."""

    default_code = "topology"


class ControlPointError(EngineError):
    """Control points that cannot be resolved or cannot all be met: names them."""

    default_code = "control_point"


class RegistrationError(EngineError):
    """Two meshes that cannot be brought together."""

    default_code = "registration"


class ParameterizationError(EngineError):
    """No bijection onto the disk was found: names the faces."""

    default_code = "parameterization"


class QuasiconformalError(EngineError):
    """The control points cannot be reached without folds: names the points near the folds."""

    default_code = "quasiconformal"


class RestorationError(EngineError):
    """The surface cannot be restored from its plane."""

    default_code = "restoration"


class NumericalError(EngineError):
    """A linear system is singular or not positive definite where it must be."""

    default_code = "numerical"
