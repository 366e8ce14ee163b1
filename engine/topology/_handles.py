"""The Euler characteristic decides whether a surface is a sphere with holes."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from engine.errors import TopologyError
from engine.topology._halfedges import edge_count, edge_runs, origins, targets
from engine.types import IntArray, Mesh


def euler_characteristic(faces: IntArray) -> int:
    """Vertices - edges + faces of a triangle list."""
    used = np.zeros(int(faces.max(initial=-1)) + 1, dtype=np.bool_)
    used[faces] = True
    return int(used.sum()) - edge_count(faces) + len(faces)


def refuse_handles(mesh: Mesh, loops: list[IntArray]) -> None:
    """Raise ``TopologyError`` unless closing all ``loops`` makes a sphere of the surface."""
    handles = (2 - euler_characteristic(mesh.faces) - len(loops)) // 2
    if handles:
        around = handle_vertices(mesh)
        raise TopologyError(
            f"the surface has {handles} handle(s), like a torus: a face must be a disk or a sphere "
            f"once its holes are closed. Cut each handle or close the tunnel, for instance near "
            f"vertex {around[0]} of the surface",
            code="handles",
            elements={"handles": handles, "vertices": around[:100].tolist()},
        )


def handle_vertices(mesh: Mesh) -> IntArray:
    """Vertices of one closed path that does not separate the surface.

    Tree and cotree (Eppstein 2003): an edge outside a spanning tree of the faces' dual graph and
    outside a spanning tree of the remaining edges closes such a path. If the shallow tree leaves
    only boundary edges, which may close a path around a hole, the tree is made of these first.
    """
    faces, count = mesh.faces, len(mesh.vertices)
    runs = edge_runs(faces)
    inner = runs.size == 2
    left, right = runs.order[runs.start[inner]], runs.order[runs.start[inner] + 1]
    dual = sparse.coo_array(
        (np.ones(len(left)), (left // 3, right // 3)), shape=(len(faces), len(faces))
    ).tocsr()
    _, before = breadth_first_order(dual, 0, directed=False)
    in_cotree = (before[left // 3] == right // 3) | (before[right // 3] == left // 3)
    free = left[~in_cotree]
    rest = np.concatenate([free, runs.order[runs.start[runs.size == 1]]])
    a, b = origins(faces)[rest], targets(faces)[rest]
    graph = sparse.coo_array((np.ones(len(a)), (a, b)), shape=(count, count)).tocsr()
    parent, candidates = _closing(graph, a, b, len(free))
    if not len(candidates):
        rim_first = np.where(np.arange(len(a)) < len(free), 2.0, 1.0)
        graph = sparse.coo_array((rim_first, (a, b)), shape=(count, count)).tocsr()
        parent, candidates = _closing(minimum_spanning_tree(graph), a, b, len(free))
    paths = [_cycle(parent, int(a[i]), int(b[i])) for i in candidates[:64]]
    return np.array(min(paths, key=len), dtype=np.int64)


def _closing(
    graph: sparse.csr_array, a: IntArray, b: IntArray, free_count: int
) -> tuple[IntArray, IntArray]:
    """A breadth-first tree's parents, and which of the first edges a-b are not in it."""
    _, parent = breadth_first_order(graph, int(a[0]), directed=False)
    in_tree = (parent[a] == b) | (parent[b] == a)
    return parent, np.flatnonzero(~in_tree[:free_count])


def _cycle(parent: IntArray, a: int, b: int) -> list[int]:
    path_a, path_b = _to_root(parent, a), _to_root(parent, b)
    while len(path_a) > 1 and len(path_b) > 1 and path_a[-2] == path_b[-2]:
        path_a.pop()
        path_b.pop()
    return path_a + path_b[-2::-1]


def _to_root(parent: IntArray, vertex: int) -> list[int]:
    path = [vertex]
    while parent[path[-1]] >= 0:
        path.append(int(parent[path[-1]]))
    return path
