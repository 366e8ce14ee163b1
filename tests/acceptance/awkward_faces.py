"""The small face in every odd shape that modelling programs and scanners make of one."""

from __future__ import annotations

import numpy as np

from engine.types import FloatArray
from tests.acceptance.files import SMALL, obj, ply, small

SEED = 11
FLIPPED = 0.3
ISLANDS = 40
UTM = (512_345.0, 5_403_210.0, 250.0)


def with_nan() -> bytes:
    face = small()
    vertices = face.vertices.copy()
    vertices[123, 1] = np.nan
    return ply(vertices, face.faces)


def index_out_of_range() -> bytes:
    face = small()
    faces = face.faces.copy()
    faces[50, 2] = len(face.vertices)
    return ply(face.vertices, faces)


def truncated() -> bytes:
    face = small()
    whole = ply(face.vertices, face.faces)
    return whole[: 2 * len(whole) // 3]


def points_only() -> bytes:
    return ply(small().vertices, np.empty((0, 3), dtype=np.int64))


def negative_indices() -> bytes:
    """CRLF, tabs, exponents, indices from the end, normals, groups, lines that go on."""
    face = small()
    count = len(face.vertices)
    lines = ["# counted from the end", "mtllib no such material.mtl", "g the\tface"]
    lines += [f"v\t{x:.7e} {y:.7e}  {z:.7e} 1.0" for x, y, z in face.vertices]
    lines += ["vn 0 0 1", "s 1"]
    lines += [f"f {a - count}//-1 {b - count}//-1 \\\r\n {c - count}//-1" for a, b, c in face.faces]
    return "\r\n".join([*lines, ""]).encode()


def polygons() -> bytes:
    """Quadrilaterals wherever two triangles in a row share an edge."""
    face = small()
    drawn: list[list[int]] = []
    left = face.faces.tolist()
    while left:
        first = left.pop()
        shared = set(first) & set(left[-1]) if left else set()
        if len(shared) != 2:
            drawn.append(first)
            continue
        (apex,) = set(left.pop()) - shared
        (opposite,) = set(first) - shared
        at = first.index(opposite)
        drawn.append([first[(at + 1) % 3], apex, first[(at + 2) % 3], opposite])
    return obj(face.vertices, drawn)


def big_endian_doubles() -> bytes:
    face = small()
    shade = np.random.default_rng(SEED).integers(0, 256, len(face.vertices))
    colours = dict.fromkeys(("red", "green", "blue"), ("u1", shade))
    return ply(face.vertices, face.faces, real="f8", order=">", extra=colours)


def soup(count: int = SMALL) -> bytes:
    face = small(count=count)
    return ply(face.vertices[face.faces.ravel()], np.arange(face.faces.size).reshape(-1, 3))


def partly_flipped() -> bytes:
    face = small()
    turned = np.random.default_rng(SEED).random(len(face.faces)) < FLIPPED
    return ply(face.vertices, np.where(turned[:, None], face.faces[:, ::-1], face.faces))


def fins() -> bytes:
    """Two triangles that stand on inner edges, and two faces that are there twice."""
    face = small()
    extra = face.vertices[face.faces[[200, 900], 0]] + (0.0, 0.0, 2.0)
    count = len(face.vertices)
    stand = np.column_stack([face.faces[[200, 900], :2], [count, count + 1]])
    vertices = np.concatenate([face.vertices, extra])
    return ply(vertices, np.concatenate([face.faces, stand, face.faces[[5, 6]]]))


def islands() -> bytes:
    face = small()
    chance = np.random.default_rng(SEED)
    corners = chance.uniform(-15, 15, (ISLANDS, 1, 3)) + chance.normal(0, 0.1, (ISLANDS, 3, 3))
    loose = len(face.vertices) + np.arange(3 * ISLANDS).reshape(-1, 3)
    vertices = np.concatenate([face.vertices, corners.reshape(-1, 3)])
    return ply(vertices, np.concatenate([face.faces, loose]))


def pinholes() -> bytes:
    """Every hundredth face is missing."""
    face = small()
    return ply(face.vertices, np.delete(face.faces, np.s_[50::100], axis=0))


def bow_ties() -> bytes:
    """Small spheres that touch the skin at one of its vertices each, sharing it."""
    face = small()
    at = face.faces[[200, 900], 0]
    vertices, faces = [face.vertices], [face.faces]
    for vertex in at:
        count = sum(map(len, vertices))
        corners = np.array([(0.2, 0.0, 0.6), (-0.1, 0.2, 0.6), (-0.1, -0.2, 0.6)])
        vertices.append(face.vertices[vertex] + corners)
        a, b, c = count + np.arange(3)
        faces.append(np.array([(a, b, c), (b, a, vertex), (c, b, vertex), (a, c, vertex)]))
    return ply(np.concatenate(vertices), np.concatenate(faces))


def leftovers() -> bytes:
    """An OBJ with needles, points, lines, a curve, a vertex of no face and words of nobody's."""
    face = small()
    count = len(face.vertices)
    lines = obj(face.vertices, face.faces.tolist()).decode().splitlines()
    lines += ["v 0 0 20", "p 1", "l 1 2 3", "cstype bezier", "deg 3", "end", "sculpt_layer 3"]
    lines += [f"f {a + 1} {b + 1} {a + 1}" for a, b, _ in face.faces[[5, 80]]]
    return "\n".join([*lines, f"# {count}", ""]).encode()


def two_discs() -> bytes:
    face = small()
    count = len(face.vertices)
    aside = face.vertices + np.array([40.0, 0.0, 0.0])
    vertices = np.concatenate([face.vertices, aside])
    return ply(vertices, np.concatenate([face.faces, face.faces + count]))


def far_away() -> bytes:
    face = small()
    return ply(face.vertices + UTM, face.faces, real="f8")


def mobius_strip() -> bytes:
    sections = 40
    turn = np.linspace(0, 2 * np.pi, sections, endpoint=False)
    rims = [_ring(10 + side * np.cos(turn / 2), side * np.sin(turn / 2), turn) for side in (-2, 2)]
    here = np.arange(sections)
    low, high = here, here + sections
    last = here == sections - 1
    next_low = np.where(last, sections, (here + 1) % sections)
    next_high = np.where(last, 0, (here + 1) % sections + sections)
    faces = [[low, next_low, high], [high, next_low, next_high]]
    return ply(np.concatenate(rims), np.concatenate([np.column_stack(face) for face in faces]))


def torus() -> bytes:
    around, across = 40, 20
    u, v = np.divmod(np.arange(around * across), across)
    angle, tube = 2 * np.pi * u / around, 2 * np.pi * v / across
    mesh = _ring(10 + 3 * np.cos(tube), 3 * np.sin(tube), angle)
    right, up = (u + 1) % around * across + v, u * across + (v + 1) % across
    corner = (u + 1) % around * across + (v + 1) % across
    faces = [[u * across + v, right, corner], [u * across + v, corner, up]]
    return ply(mesh, np.concatenate([np.column_stack(face) for face in faces]))


def _ring(radius: FloatArray, height: FloatArray, angle: FloatArray) -> FloatArray:
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
