"""Make ``engine/data/expressions.npz`` from the blendshapes of ICT FaceKit (MIT).

    python scripts/make_expressions.py FaceXModel

``FaceXModel`` is the folder of the published model: ``generic_neutral_mesh.obj``, one OBJ per
expression and ``identity000.obj`` and so on, all over the same vertices, in centimetres. Kept are
the face patch (vertices 0 to 9408), decimated to its own vertices, every expression that moves
skin, and the first identities.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from engine.correspondence._levels import build_level
from engine.io import read_mesh
from engine.topology import boundary_loops
from engine.types import FloatArray, Mesh

FACE_VERTICES = 9409
KEPT_VERTICES = 3000
IDENTITIES = 40
OUT = Path(__file__).parent.parent / "engine" / "data" / "expressions.npz"


def vertices(path: Path) -> FloatArray:
    return read_mesh(path).mesh.vertices[:FACE_VERTICES]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", type=Path)
    folder = parser.parse_args().model
    whole = read_mesh(folder / "generic_neutral_mesh.obj").mesh
    faces = whole.faces[(whole.faces < FACE_VERTICES).all(axis=1)]
    mesh = Mesh(whole.vertices[:FACE_VERTICES], faces)
    kept = build_level(mesh, boundary_loops(faces, FACE_VERTICES), KEPT_VERTICES)
    others = {"generic_neutral_mesh", "PupilDilate_L", "PupilDilate_R"}
    names = sorted(p.stem for p in folder.glob("*.obj") if not p.stem.startswith("identity"))
    names = [name for name in names if name not in others]
    identities = [f"identity{k:03d}" for k in range(IDENTITIES)]

    def offsets(stems: list[str]) -> FloatArray:
        rows = [(vertices(folder / f"{s}.obj") - mesh.vertices)[kept.kept] for s in stems]
        return np.stack(rows).astype(np.float16)

    np.savez_compressed(
        OUT,
        vertices=mesh.vertices[kept.kept].astype(np.float32),
        faces=kept.mesh.faces.astype(np.int16),
        names=np.array(names),
        expressions=offsets(names),
        identities=offsets(identities),
    )
    print(f"{OUT}: {len(kept.kept)} vertices, {len(names)} expressions, {OUT.stat().st_size} bytes")


if __name__ == "__main__":
    main()
