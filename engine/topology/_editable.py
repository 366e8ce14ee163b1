"""From the triangles of a file to the one surface that is edited (design: file to surface)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.errors import TopologyError
from engine.topology._copies import kinds_and_joined
from engine.topology._corners import separate_corners
from engine.topology._halfedges import origins, twins
from engine.topology._handles import refuse_handles
from engine.topology._loops import edge_loops
from engine.topology._scattering import refuse_scattered
from engine.topology._sheets import Sheets, joined_sheets, turned_faces
from engine.topology._sheets_kernels import face_areas
from engine.topology._welding import position_classes, stitch
from engine.topology._welding_kernels import DEGENERATE, PROPER, REPEATED
from engine.types import BoolArray, IntArray, Mesh, MeshWarning, Surface

PINHOLE_CORNERS = 4
LIKE_IN_SIZE = 0.95
FACES_PER_PLACE = 4
"""A surface has 2, with fins and handles a few more; in a solid's inside it is 12."""


def editable_surface(
    mesh: Mesh, *, near: IntArray | None = None, outer: IntArray | None = None
) -> tuple[Surface, tuple[MeshWarning, ...]]:
    """The connected, oriented manifold of ``mesh`` to edit, and what had to be handled for it.

    Edges at exactly the same place are welded, degenerate and repeated faces left out, faces
    that make an edge crowded (fins) left out, windings made alike after the larger area. Of the
    pieces the one is taken that holds most of the file vertices ``near``, else the largest by
    area, if no other comes near it. Where sheets touch at a vertex it stays one vertex if the
    boundary runs through it (the closing of holes makes it regular), else every sheet gets its
    own, and the file's vertex goes with the largest. A file vertex in no kept face goes with a
    surface vertex at its exact place.

    ``loops`` start with the outer one: that with most of the file vertices ``outer``, else the
    longest. Raises ``TopologyError`` for a mesh without area, with one side only, with handles, or
    with two pieces of which either could be meant.
    """
    work = _Work(mesh)
    if not len(mesh.faces):
        raise TopologyError(
            "the mesh has no faces, only points: a surface is needed", code="no_faces"
        )
    kept, joined = _proper_faces(work)
    work.proper = kept
    welded = stitch(joined[mesh.faces[kept]], work.position)[joined]
    joined = np.flatnonzero(welded != np.arange(len(welded)))
    work.warn("welded_vertices", "{} vertices lie exactly on others along edges: joined", joined)
    kept, faces = _one_piece(work, kept, welded, near)
    return _surface(work, kept, faces, welded, outer), tuple(work.warnings)


@dataclass(slots=True)
class _Work:
    mesh: Mesh
    position: IntArray
    proper: IntArray
    warnings: list[MeshWarning]

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.position = position_classes(mesh.vertices)
        self.proper = np.empty(0, np.int64)
        self.warnings = []

    def warn(self, code: str, message: str, found: IntArray, elements: str = "vertices") -> None:
        if len(found):
            first = tuple(int(i) for i in found[:10])
            text = message.format(len(found))
            self.warnings.append(MeshWarning(code, text, elements, len(found), first))

    def warn_of_many(self, code: str, message: str, found: BoolArray) -> None:
        """Of faces, which may be nearly all: not listed as a whole."""
        count, first = int(np.count_nonzero(found)), list[int]()
        while len(first) < min(count, 10):
            after = first[-1] + 1 if first else 0
            first.append(after + int(np.argmax(found[after:])))
        if count:
            text = message.format(count)
            self.warnings.append(MeshWarning(code, text, "faces", count, tuple(first)))


def _proper_faces(work: _Work) -> tuple[IntArray, IntArray]:
    """The faces to look at, and for each vertex the lowest that repeated faces join it to."""
    faces = work.mesh.faces
    used = np.zeros(len(work.mesh.vertices), dtype=np.bool_)
    used[faces] = True
    work.warn(
        "unreferenced_vertices", "{} vertices belong to no face: left alone", np.flatnonzero(~used)
    )
    places = _different(work.position[used])
    many = len(faces) > FACES_PER_PLACE * places
    if not many:
        refuse_scattered(work.mesh.vertices, faces, work.position)
    kinds, joined = kinds_and_joined(work.mesh, work.position)
    for kind, code, message in (
        (DEGENERATE, "degenerate_faces", "{} faces have two corners at one place: left out"),
        (REPEATED, "duplicate_faces", "{} faces repeat others: left out"),
    ):
        work.warn_of_many(code, message, kinds == kind)
    kept = np.flatnonzero(kinds == PROPER)
    _refuse_solids(len(kept), places)
    if many:
        refuse_scattered(work.mesh.vertices, faces[kept], work.position)
    if not face_areas(work.mesh.vertices, faces[kept]).any():
        raise TopologyError(
            f"none of the {len(faces)} faces has an area: the vertices lie on points or lines",
            code="degenerate",
            elements={"faces": list(range(min(len(faces), 100)))},
        )
    return kept, joined


def _different(place: IntArray) -> int:
    found = np.zeros(int(place.max(initial=-1)) + 1, dtype=np.bool_)
    found[place] = True
    return int(np.count_nonzero(found))


def _refuse_solids(face_count: int, place_count: int) -> None:
    if face_count > FACES_PER_PLACE * place_count:
        raise TopologyError(
            f"{face_count} different faces have only {place_count} corners between them, where a "
            f"surface has two faces per corner: export the outside of the solid alone",
            code="not_a_surface",
            elements={"face_count": face_count, "corner_count": place_count},
        )


def _one_piece(
    work: _Work, kept: IntArray, welded: IntArray, near: IntArray | None
) -> tuple[IntArray, IntArray]:
    """The faces of the piece to edit, without fins and wound alike, as file triangles and corners.

    No edge has more than two of them.
    """
    vertices = work.mesh.vertices
    sheets = joined_sheets(vertices, welded[work.mesh.faces[kept]])
    chosen = _choice(work, sheets, kept, near)
    _warn_other_pieces(work, sheets, kept, chosen)
    crowded = kept[sheets.crowded.min(axis=1) // 3]
    crowded = crowded[sheets.piece[sheets.crowded[:, 0] // 3] == chosen]
    left_out = 0
    inside = sheets.piece == chosen
    while len(surplus := _inside(sheets.surplus // 3, inside)):
        inside[surplus] = False
        left_out += len(surplus)
        kept = kept[inside]
        if not len(kept):
            raise TopologyError(
                "three or more faces meet at every edge: no surface is left of them; export the "
                "outside alone",
                code="not_a_surface",
            )
        sheets = joined_sheets(vertices, welded[work.mesh.faces[kept]])
        chosen = _choice(work, sheets, kept, near)
        inside = sheets.piece == chosen
    text = "{} edges have more than two faces: the two that continue each other were kept"
    work.warn(
        "nonmanifold_edges",
        f"{text}, {left_out} faces of the surface left out",
        np.sort(crowded),
        "faces",
    )
    kept = kept[inside]
    faces = welded[work.mesh.faces[kept]]
    turned = turned_faces(faces, sheets.only(inside), sheets.area[inside])
    work.warn("flipped_faces", "{} faces were wound the other way: turned", kept[turned], "faces")
    if not turned.any():
        return kept, faces
    return kept, np.where(turned[:, None], faces[:, [0, 2, 1]], faces)


def _inside(faces: IntArray, inside: BoolArray) -> IntArray:
    return np.unique(faces[inside[faces]])


def _choice(work: _Work, sheets: Sheets, kept: IntArray, near: IntArray | None) -> int:
    if near is None or not len(near):
        return _largest(sheets, kept)
    wanted = np.zeros(len(work.position), dtype=np.bool_)
    wanted[work.position[near]] = True
    corner_place = work.position[work.mesh.faces[kept]]
    hit, corner = np.nonzero(wanted[corner_place])
    pairs = np.unique(np.stack([sheets.piece[hit], corner_place[hit, corner]]), axis=1)
    held = np.bincount(pairs[0], minlength=len(sheets.piece_area))
    best = np.flatnonzero(held == held.max())
    return int(best[np.argmax(sheets.piece_area[best])])


def _largest(sheets: Sheets, kept: IntArray) -> int:
    """The piece of the largest area, refused if another is of about the same."""
    area = sheets.piece_area
    largest = int(np.argmax(area))
    alike = np.flatnonzero(area >= LIKE_IN_SIZE * area[largest])
    if len(alike) > 1:
        first = [int(kept[np.argmax(sheets.piece == piece)]) for piece in alike[:10]]
        raise TopologyError(
            f"{len(alike)} components are of about the same area, the largest of "
            f"{len(area)}: which is the face? Delete the others, or join them to one surface",
            code="ambiguous",
            elements={"faces": first, "count": len(alike), "components": len(area)},
        )
    return largest


def _warn_other_pieces(work: _Work, sheets: Sheets, kept: IntArray, chosen: int) -> None:
    first = np.zeros(len(sheets.piece_area), dtype=np.int64)
    first[sheets.piece[::-1]] = np.arange(len(kept))[::-1]
    others = np.sort(kept[np.delete(first, chosen)])
    work.warn(
        "other_components",
        "{} other components follow the edited surface",
        others,
        "faces",
    )


def _surface(
    work: _Work, kept: IntArray, faces: IntArray, welded: IntArray, outer: IntArray | None
) -> Surface:
    twin = twins(faces)
    vertices = work.mesh.vertices
    loops = edge_loops(faces, twin, len(welded), vertices)
    split = separate_corners(vertices, faces, twin, loops)
    work.warn(
        "split_vertices",
        "{} vertices where sheets of the surface only touch were divided",
        np.unique(split.source[split.extra :]),
    )
    mesh = Mesh(vertices[split.source], split.faces)
    vertex_of = _with_coincident(work, split.vertex_of[welded], split.source, welded)
    rings = [origins(split.faces)[loop] for loop in loops]
    refuse_handles(mesh, rings)
    rings = _outer_first(mesh, rings, vertex_of, outer)
    small = [int(split.source[ring].min()) for ring in rings[1:] if len(ring) <= PINHOLE_CORNERS]
    work.warn(
        "pinholes", "{} holes of three or four edges", np.sort(np.array(small, dtype=np.int64))
    )
    return Surface(mesh, vertex_of, kept, tuple(rings))


def _with_coincident(
    work: _Work, vertex_of: IntArray, source: IntArray, welded: IntArray
) -> IntArray:
    """Let vertices of left-out faces and of none go with a surface vertex at their place."""
    at_place = np.full(len(vertex_of), -1, dtype=np.int64)
    at_place[work.position[source[::-1]]] = np.arange(len(source))[::-1]
    in_face = np.zeros(len(vertex_of), dtype=np.bool_)
    in_face[welded[work.mesh.faces[work.proper]]] = True
    free = (vertex_of < 0) & ~in_face[welded]
    return np.where(free, at_place[work.position], vertex_of)


def _outer_first(
    mesh: Mesh, rings: list[IntArray], vertex_of: IntArray, outer: IntArray | None
) -> list[IntArray]:
    def order(ring: IntArray) -> tuple[float, list[float]]:
        corners = mesh.vertices[ring]
        length = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum()
        return float(np.float32(length)), min(corners.tolist())

    named = np.unique(vertex_of[outer]) if outer is not None else np.empty(0, dtype=np.int64)
    ordered = sorted(rings, key=order, reverse=True)
    held = [int(np.isin(ring, named).sum()) for ring in ordered]
    first = int(np.argmax(held)) if held else 0
    return ordered[first : first + 1] + ordered[:first] + ordered[first + 1 :]
