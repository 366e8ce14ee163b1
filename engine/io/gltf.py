"""GLB: the source mesh with its targets as morph targets and its frames as an animation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from pygltflib import (
    ARRAY_BUFFER,
    ELEMENT_ARRAY_BUFFER,
    FLOAT,
    GLTF2,
    SCALAR,
    UNSIGNED_INT,
    VEC3,
    Accessor,
    Animation,
    AnimationChannel,
    AnimationChannelTarget,
    AnimationSampler,
    Asset,
    Attributes,
    Buffer,
    BufferView,
    Material,
    Node,
    PbrMetallicRoughness,
    Primitive,
    Scene,
)
from pygltflib import Mesh as GltfMesh

from engine.io._mesh_file import MeshFile
from engine.io._normals import vertex_normals
from engine.types import FloatArray


class _Blob:
    """The binary chunk under construction, with the accessors that describe it."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0
        self.views: list[BufferView] = []
        self.accessors: list[Accessor] = []

    def add(
        self,
        values: NDArray[np.float32] | NDArray[np.uint32],
        *,
        target: int | None,
        bounds: bool = False,
    ) -> int:
        """Append an array of numbers (k,) or of 3-vectors (k, 3); returns its accessor."""
        part = values.tobytes()
        rows = values.reshape(len(values), -1)
        view = BufferView(buffer=0, byteOffset=self.size, byteLength=len(part), target=target)
        accessor = Accessor(
            bufferView=len(self.views),
            componentType=FLOAT if values.dtype == np.float32 else UNSIGNED_INT,
            count=len(values),
            type=VEC3 if values.ndim == 2 else SCALAR,
            min=rows.min(axis=0).tolist() if bounds else None,
            max=rows.max(axis=0).tolist() if bounds else None,
        )
        self.parts.append(part)
        self.size += len(part)
        self.views.append(view)
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def write_glb(
    file: MeshFile,
    *,
    targets: Mapping[str, FloatArray],
    frames: Sequence[FloatArray],
    seconds: float = 1.0,
) -> bytes:
    """A GLB of the file's triangles with named morph targets and an animation.

    ``targets``: (n, 3) vertex positions by name, each a morph target of that name (listed in
    ``mesh.extras.targetNames``). ``frames``: (n, 3) positions each, evenly spread over
    ``seconds``; each is one more morph target ``frame-0000`` ..., and the animation fades each
    into the next, so that it passes through all of them exactly. Positions are 32-bit, relative
    to the centre of the bounding box, which is the node's translation. Units are the file's.
    """
    vertices, faces = file.mesh.vertices, file.mesh.faces
    shapes = {name: file.positions(shape) for name, shape in targets.items()}
    shapes |= {f"frame-{i:04d}": file.positions(shape) for i, shape in enumerate(frames)}
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    blob = _Blob()
    base = Attributes(
        POSITION=blob.add((vertices - centre).astype(np.float32), target=ARRAY_BUFFER, bounds=True),
        NORMAL=blob.add(vertex_normals(vertices, faces).astype(np.float32), target=ARRAY_BUFFER),
    )
    indices = blob.add(faces.reshape(-1).astype(np.uint32), target=ELEMENT_ARRAY_BUFFER)
    morphs = [
        Attributes(POSITION=blob.add(_delta(shape, vertices), target=ARRAY_BUFFER, bounds=True))
        for shape in shapes.values()
    ]
    mesh = GltfMesh(
        primitives=[Primitive(attributes=base, indices=indices, material=0, targets=morphs)],
        weights=[0.0] * len(shapes),
        extras={"targetNames": list(shapes)},
    )
    animations = [_animation(blob, len(targets), len(frames), seconds)] if frames else []
    return _container(blob, mesh, animations, centre)


def _delta(shape: FloatArray, vertices: FloatArray) -> NDArray[np.float32]:
    return (shape - vertices).astype(np.float32)


def _animation(blob: _Blob, target_count: int, frame_count: int, seconds: float) -> Animation:
    """Weights at ``frame_count`` times: one frame's is 1, all others are 0, linear between."""
    times = np.linspace(0.0, seconds, frame_count).astype(np.float32)
    weights = np.hstack([np.zeros((frame_count, target_count)), np.eye(frame_count)])
    sampler = AnimationSampler(
        input=blob.add(times, target=None, bounds=True),
        output=blob.add(weights.astype(np.float32).reshape(-1), target=None),
        interpolation="LINEAR",
    )
    channel = AnimationChannel(sampler=0, target=AnimationChannelTarget(node=0, path="weights"))
    return Animation(name="edit", samplers=[sampler], channels=[channel])


def _container(
    blob: _Blob, mesh: GltfMesh, animations: list[Animation], centre: FloatArray
) -> bytes:
    gltf = GLTF2(
        asset=Asset(version="2.0", generator="quasiface"),
        scene=0,
        scenes=[Scene(nodes=[0])],
        nodes=[Node(mesh=0, translation=centre.tolist())],
        meshes=[mesh],
        materials=[
            Material(
                pbrMetallicRoughness=PbrMetallicRoughness(
                    baseColorFactor=[0.8, 0.75, 0.7, 1.0], metallicFactor=0.0, roughnessFactor=0.8
                ),
                doubleSided=True,
            )
        ],
        accessors=blob.accessors,
        bufferViews=blob.views,
        buffers=[Buffer(byteLength=blob.size)],
        animations=animations,
    )
    gltf.set_binary_blob(b"".join(blob.parts))
    return b"".join(gltf.save_to_bytes())
