"""Files with everything that real ones have, made from the bundled faces."""

from __future__ import annotations

import numpy as np

from engine.io import MeshFile, read_mesh
from tests.faces import HEAD_NEUTRAL, ICT_NEUTRAL


def face() -> MeshFile:
    return read_mesh(ICT_NEUTRAL)


def head() -> MeshFile:
    return read_mesh(HEAD_NEUTRAL)


def polygons(file: MeshFile) -> list[list[int]]:
    corners = np.split(file.corners, file.offsets[1:-1])
    return [each.tolist() for each in corners]


def custom_ply(order: str, *, scalar: str = "f8", normals: bool = False) -> bytes:
    """Binary PLY of the face: colours, custom properties, a list and foreign elements around."""
    file = face()
    n = len(file.mesh.vertices)
    name = {"f8": "double", "f4": "float"}[scalar]
    fields = [("red", "u1"), ("quality", f"{order}f4"), ("z", f"{order}{scalar}")]
    fields += [("x", f"{order}{scalar}"), ("y", f"{order}{scalar}"), ("label", f"{order}i2")]
    fields += [(k, f"{order}f4") for k in ("nx", "ny", "nz")] if normals else []
    names = {"u1": "uchar", "f4": "float", "i2": "short", "f8": "double"}
    rows = np.zeros(n, np.dtype(fields))
    rng = np.random.default_rng(3)
    rows["red"], rows["label"] = rng.integers(0, 255, n), rng.integers(-9, 9, n)
    rows["quality"] = rng.random(n)
    rows["x"], rows["y"], rows["z"] = file.mesh.vertices.T
    if normals:
        rows["nz"] = 1
    lists = np.zeros(
        len(file.mesh.faces), np.dtype([("f", "u1"), ("n", "u1"), ("v", f"{order}i4", 3)])
    )
    lists["f"], lists["n"], lists["v"] = 7, 3, file.mesh.faces
    endian = "little" if order == "<" else "big"
    header = [f"ply\nformat binary_{endian}_endian 1.0\ncomment made: by tests\nobj_info none"]
    header += ["element camera 2", "property list ushort double views"]
    header += [f"element vertex {n}"]
    header += [f"property {names[t[-2:]] if t[-2:] != scalar else name} {k}" for k, t in fields]
    header += [f"element face {len(lists)}", "property uchar flags"]
    header += ["property list uchar int vertex_index", "element edge 1", "property int vertex1"]
    camera = np.array([1], f"{order}u2").tobytes() + np.array([0.5], f"{order}f8").tobytes()
    camera += np.array([0], f"{order}u2").tobytes()
    body = camera + rows.tobytes() + lists.tobytes() + np.array([4], f"{order}i4").tobytes()
    return "\n".join([*header, "end_header\n"]).encode() + body


def ascii_ply() -> bytes:
    """Text PLY of the head's quads: colour before x, a foreign element on either side."""
    file = head()
    lines = ["ply", "format ascii 1.0", "element camera 1", "property float view"]
    lines += [f"element vertex {len(file.mesh.vertices)}", "property uchar red"]
    lines += [f"property float {k}" for k in "xyz"]
    lines += [f"element face {file.polygon_count}", "property uchar flags"]
    lines += ["property list uchar uint vertex_indices", "element edge 1", "property int a"]
    lines += ["end_header", "0.25"]
    lines += [f"200 {x:.5f} {y:.5f} {z:.5f}" for x, y, z in file.mesh.vertices.tolist()]
    lines += [f"9 {len(p)} {' '.join(map(str, p))}" for p in polygons(file)]
    return "\n".join([*lines, "77"]).encode() + b"\n"


def awkward_obj() -> bytes:
    """OBJ of the head's quads: CRLF, tabs, exponents, w, negative indices, continuation."""
    file = head()
    n = len(file.mesh.vertices)
    lines = ["\ufeff# C:\\faces\\", "mtllib does not exist.mtl", "o face one"]
    lines += [f"v\t{x:.5e}   {y:.5e} {z:.5e} 1.0" for x, y, z in file.mesh.vertices.tolist()]
    lines += ["vn 0 0 1", "g part0 face", "s 1", "cstype bezier", "p 1 2", "l 1 2 3"]
    for i, polygon in enumerate(polygons(file)):
        corners = [f"{v - n}//-1" for v in polygon]
        gap = " \\\r\n  " if i % 50 == 0 else " "
        lines += [f"f {corners[0]} {corners[1]}{gap}{' '.join(corners[2:])} # face"]
        lines += [f"usemtl skin{i}"] if i % 1000 == 0 else []
    return "\r\n".join([*lines, ""]).encode()


def obj_with_normals() -> bytes:
    """OBJ of the face patch with vertex colours and one unit normal per vertex."""
    mesh = face().mesh
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.zeros(mesh.vertices.shape)
    for k in range(3):
        np.add.at(normals, mesh.faces[:, k], np.cross(b - a, c - a))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    lines = [f"v {x:.6f} {y:.6f} {z:.6f} 0.8 0.6 0.5" for x, y, z in mesh.vertices.tolist()]
    lines += [f"vn {x:.4f} {y:.4f} {z:.4f}" for x, y, z in normals.tolist()]
    lines += ["f " + " ".join(f"{v}//{v}" for v in f) for f in (mesh.faces + 1).tolist()]
    return "\n".join([*lines, ""]).encode()
