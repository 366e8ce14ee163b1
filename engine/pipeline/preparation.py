"""From files to surfaces, disks and correspondences: all that edits of the same meshes share."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from engine.controls import Address, AddressedMesh, vertices_near
from engine.correspondence import (
    Expressions,
    correspond,
    expression_template,
    lay_expressions,
)
from engine.errors import RegistrationError, TopologyError
from engine.io import MeshFile, vertex_colours
from engine.parameterization import disk_map
from engine.pipeline.values import Match, Options, Prepared, Stages
from engine.registration import register
from engine.topology import disk_surface, editable_surface, used_vertices
from engine.types import FloatArray, IntArray, Mesh, MeshWarning, Surface, SurfacePoints
from engine.visibility import ambient_visibility


def fingerprint(*values: NDArray[np.generic] | str) -> str:
    """A digest of arrays and words: the key under which a stage's result may be kept."""
    digest = hashlib.sha256()
    for value in values:
        digest.update(value.encode() if isinstance(value, str) else value.tobytes())
        digest.update(b"\0")
    return digest.hexdigest()


def mesh_fingerprint(file: MeshFile) -> str:
    """A digest of a file's geometry and connectivity."""
    return fingerprint(file.mesh.vertices, file.mesh.faces)


def normalisation(mesh: Mesh) -> tuple[FloatArray, float]:
    """Centre and diagonal of the bounding box of the vertices that faces use."""
    if not mesh.faces.size:
        raise TopologyError("the file has no faces: a surface is needed", code="no_faces")
    used = mesh.vertices[used_vertices(mesh)]
    low, high = used.min(axis=0), used.max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    if not diagonal > 0.0:
        raise TopologyError(
            "all vertices are at the same place: the mesh has no extent", code="no_extent"
        )
    return (low + high) / 2.0, diagonal


def find_surface(
    file: MeshFile, addresses: Sequence[Address]
) -> tuple[Surface, FloatArray, float, tuple[MeshWarning, ...]]:
    """The editable surface that the addresses mean, in normalised coordinates."""
    centre, diagonal = normalisation(file.mesh)
    near = vertices_near(file.mesh, file.first_face, addresses) if addresses else None
    scaled = file.mesh.moved((file.mesh.vertices - centre) / diagonal)
    surface, warnings = editable_surface(scaled, near=near)
    return surface, centre, diagonal, warnings


def prepare(
    file: MeshFile, options: Options, stages: Stages, addresses: Sequence[Address] = ()
) -> Prepared:
    """Stages 0 and 2 for one file: editable surface and disk map."""
    near = vertices_near(file.mesh, file.first_face, addresses)
    key = fingerprint(mesh_fingerprint(file), near)
    surface, centre, diagonal, warnings = stages.run(
        "topology", key, lambda: find_surface(file, addresses)
    )
    keep = surface.vertex_of[near]
    keep = np.unique(keep[keep >= 0])

    disk = stages.run(
        "parameterization",
        fingerprint(key, options.parameterization, options.holes),
        lambda: disk_map(
            disk_surface(surface, keep=keep if len(keep) else None, holes=options.holes),
            method=options.parameterization,
        ),
    )
    return Prepared(surface, disk, centre, diagonal, warnings)


def addressed(
    file: MeshFile, surface: Surface, centre: FloatArray, diagonal: float
) -> AddressedMesh:
    """What the addresses of a request refer to, in the file's own coordinates."""
    in_file = surface.mesh.moved(surface.mesh.vertices * diagonal + centre)
    return AddressedMesh(
        file.mesh,
        file.first_face,
        file.polygon_of,
        Surface(in_file, surface.vertex_of, surface.face_of, surface.loops),
    )


def in_units_of(source: Prepared, target: Prepared) -> Surface:
    """The target's surface, centred, in the source's normalised unit."""
    surface = target.surface
    ratio = target.diagonal / source.diagonal
    return Surface(
        surface.mesh.moved(surface.mesh.vertices * ratio),
        surface.vertex_of,
        surface.face_of,
        surface.loops,
    )


def known_expressions(
    source: Prepared, file: MeshFile, options: Options, stages: Stages
) -> Expressions | None:
    """How the source is likely to move, unless the options do without."""
    if options.correspondence == "paper" or options.expression_prior == "off":
        return None
    key = fingerprint("expressions", mesh_fingerprint(file), source.surface.face_of)
    return stages.run("correspondence", key, lambda: _laid(source.surface))


def _laid(face: Surface) -> Expressions:
    template = expression_template(face)
    try:
        return lay_expressions(face, register(face.mesh, template))
    except RegistrationError:
        return Expressions.none(template)


def visible_share(file: MeshFile, face: Prepared, stages: Stages) -> FloatArray:
    """The ambient visibility (m,) of the surface's faces; all of the file blocks the view."""
    return stages.run(
        "correspondence",
        fingerprint("visibility", mesh_fingerprint(file), face.surface.face_of),
        lambda: ambient_visibility(
            face.surface.mesh, file.mesh.moved(face.from_file(file.mesh.vertices))
        ),
    )


def surface_colours(
    files: tuple[MeshFile, MeshFile], faces: tuple[Prepared, Prepared]
) -> tuple[FloatArray, FloatArray] | None:
    """The colours (n, 3), (m, 3) of both surfaces' vertices, if both files carry some."""
    found: list[FloatArray] = []
    for file, face in zip(files, faces, strict=True):
        colours = vertex_colours(file)
        if colours is None:
            return None
        found.append(_at_surface(face.surface, colours))
    return found[0], found[1]


def _at_surface(surface: Surface, colours: FloatArray) -> FloatArray:
    """The mean ``colours`` of the file vertices that each surface vertex stands for.

    A vertex that was split off another has the colour of that one: they lie at the same place.
    """
    n = len(surface.mesh.vertices)
    of = surface.vertex_of
    counts = np.bincount(of[of >= 0], minlength=n)
    sums = np.stack([np.bincount(of[of >= 0], c, n) for c in colours[of >= 0].T], axis=1)
    named = np.flatnonzero(counts)
    mean = sums / np.maximum(counts, 1)[:, None]
    rest = np.flatnonzero(counts == 0)
    if len(rest):
        places = surface.mesh.vertices
        mean[rest] = mean[named[KDTree(places[named]).query(places[rest])[1]]]
    return mean


def match(
    source: Prepared,
    target: Prepared,
    files: tuple[MeshFile, MeshFile],
    options: Options,
    stages: Stages,
    landmarks: tuple[SurfacePoints, SurfacePoints] | None = None,
    expressions: Expressions | None = None,
) -> Match:
    """Stage 1: rigid registration and correspondence of one target."""
    surface = in_units_of(source, target)
    key = fingerprint(
        *(mesh_fingerprint(file) for file in files),
        options.registration,
        str(options.registration_tolerance),
    )
    registration = stages.run(
        "registration",
        key,
        lambda: register(
            source.surface.mesh,
            surface.mesh,
            method="paper" if options.registration == "paper" else "default",
            free_scale=options.registration == "scaled",
            tolerance=options.registration_tolerance,
        ),
    )
    stages.iterations("registration", registration.iterations, float(registration.rms[-1]))
    marks: list[NDArray[np.generic]] = []
    for points in landmarks or ():
        marks += [points.face, points.barycentric]
    visibility = colours = None
    if options.correspondence != "paper":
        colours = surface_colours(files, (source, target))
        visibility = (
            visible_share(files[0], source, stages),
            visible_share(files[1], target, stages),
        )
    correspondence = stages.run(
        "correspondence",
        fingerprint(
            key, options.correspondence, options.expression_prior, *marks, *(colours or ())
        ),
        lambda: correspond(
            source.surface,
            surface,
            registration,
            method=options.correspondence,
            landmarks=landmarks,
            expressions=expressions,
            visibility=visibility,
            colours=colours,
        ),
    )
    return Match(registration, correspondence)


def joined(first: SurfacePoints, which: IntArray) -> SurfacePoints:
    """The points ``which`` of ``first``."""
    return SurfacePoints(first.face[which], first.barycentric[which])
