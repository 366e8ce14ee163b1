"""A generated face that moves by known displacements."""

import numpy as np

from engine.topology import boundary_loops
from engine.types import FloatArray, Mesh
from tests.engine.remeshed import part_of
from tests.engine.shapes import sphere

# x and y of the middles of holes, and their half axes
MOUTH = (0.0, -0.4, 0.24, 0.035)
EYES = (-0.33, 0.2, 0.13, 0.05), (0.33, 0.2, 0.13, 0.05)
RELIEF = (  # x, y, widths in x and y, height
    (0.0, -0.05, 0.09, 0.2, 0.16),  # nose
    (0.0, -0.14, 0.13, 0.07, 0.09),  # its wings
    (0.0, 0.36, 0.45, 0.08, 0.07),  # brows
    (-0.33, 0.2, 0.16, 0.1, -0.1),  # sockets
    (0.33, 0.2, 0.16, 0.1, -0.1),
    (0.0, -0.34, 0.24, 0.05, 0.06),  # lips
    (0.0, -0.46, 0.22, 0.05, 0.06),
    (0.0, -0.72, 0.22, 0.14, 0.2),  # chin
    (0.0, -1.05, 0.5, 0.2, -0.15),  # throat
    (-0.4, -0.1, 0.2, 0.16, 0.05),  # cheeks
    (0.4, -0.1, 0.2, 0.16, 0.05),
)


def generated_face(*, holes: bool) -> Mesh:
    """The front of a head with nose, brows, lips and chin; with ``holes`` for mouth and eyes."""
    ball = sphere(6)
    front = part_of(ball, ball.vertices[:, 2] > 0.05)
    front = front.moved(front.vertices * np.array([0.8, 1.4, 1.0]))
    if holes:
        keep = np.ones(len(front.vertices), dtype=np.bool_)
        for hole in (MOUTH, *EYES):
            keep &= _radius(front.vertices, hole) > 1
        front = part_of(front, keep)
        front = front.moved(_on_edges(front))
    x, y, z = front.vertices.T
    for cx, cy, wx, wy, height in RELIEF:
        z = z + height * np.exp(-(((x - cx) / wx) ** 2) - ((y - cy) / wy) ** 2)
    return front.moved(np.stack((x, y, z), axis=1))


def _radius(points: FloatArray, hole: tuple[float, float, float, float]) -> FloatArray:
    cx, cy, a, b = hole
    return np.hypot((points[:, 0] - cx) / a, (points[:, 1] - cy) / b)


def _on_edges(mesh: Mesh) -> FloatArray:
    """Vertices whose inner loops are moved onto the ellipses that they surround."""
    moved = mesh.vertices.copy()
    for loop in boundary_loops(mesh.faces, len(mesh.vertices)):
        for cx, cy, a, b in (MOUTH, *EYES):
            around = _radius(moved[loop], (cx, cy, a, b))
            if around.max() < 3:
                moved[loop, 0] = cx + (moved[loop, 0] - cx) / around
                moved[loop, 1] = cy + (moved[loop, 1] - cy) / around
    return moved


def smile(face: Mesh) -> FloatArray:
    """Positions when the corners of the mouth go out, up and back, and cheeks rise and fill."""
    x, y, _ = face.vertices.T
    moved = face.vertices.copy()
    for side in (-1, 1):
        corner = np.exp(-(((x - side * 0.22) / 0.18) ** 2) - ((y + 0.4) / 0.18) ** 2)
        cheek = np.exp(-(((x - side * 0.38) / 0.18) ** 2) - ((y + 0.12) / 0.16) ** 2)
        moved += corner[:, None] * np.array([side * 0.12, 0.1, -0.06])
        moved += cheek[:, None] * np.array([side * 0.02, 0.05, 0.07])
    return moved


def jaw_open(face: Mesh) -> FloatArray:
    """Positions when chin and lower lip go down and back, and skin beside the mouth gives way."""
    x, y, _ = face.vertices.T
    chin = np.exp(-((x / 0.4) ** 4) - ((np.minimum(y + 0.8, 0) / 0.2) ** 2))
    soft = 1 / (1 + np.exp((y + 0.52) / 0.06))
    lens = np.clip(1 - (x / 0.2) ** 2, 0, 1)
    holes = len(boundary_loops(face.faces, len(face.vertices))) > 1
    lip = lens * (y < -0.4) if holes else np.zeros_like(x)
    share = chin * np.maximum(soft, lip * np.exp(-(((y + 0.4) / 0.25) ** 2)))
    return face.vertices + share[:, None] * np.array([0.0, -0.2, -0.06])
