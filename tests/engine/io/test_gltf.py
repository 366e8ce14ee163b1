"""GLB: what a viewer that follows the specification would show."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest

from engine.io import read_mesh, write_glb
from tests.faces import ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE


def parse(data: bytes) -> tuple[dict, list[np.ndarray]]:
    """The JSON chunk and every accessor's values, read from the container by its specification."""
    magic, version, length, json_length, kind = struct.unpack("<4sIII4s", data[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    document = json.loads(data[20 : 20 + json_length])
    binary = data[28 + json_length :]
    assert data[24 + json_length : 28 + json_length] == b"BIN\0"
    values = []
    for accessor in document["accessors"]:
        view = document["bufferViews"][accessor["bufferView"]]
        dtype = {5126: "<f4", 5125: "<u4"}[accessor["componentType"]]
        raw = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        array = np.frombuffer(raw, dtype)
        values.append(array.reshape(-1, 3) if accessor["type"] == "VEC3" else array)
        assert len(values[-1]) == accessor["count"]
        if "min" in accessor:
            assert np.allclose(values[-1].min(axis=0), accessor["min"])
            assert np.allclose(values[-1].max(axis=0), accessor["max"])
    return document, values


@pytest.mark.parametrize("offset", [0.0, 5.4e6])
def test_targets_and_frames_are_where_they_were_asked_to_be(offset: float) -> None:
    file = read_mesh(ICT_NEUTRAL)
    moved = file.mesh.vertices + offset
    data = b"".join(b"v %a %a %a\n" % tuple(v) for v in moved.tolist())
    data += b"".join(b"f %d %d %d\n" % tuple(f) for f in (file.mesh.faces + 1).tolist())
    file = read_mesh(data)
    smile, jaw = (read_mesh(p).mesh.vertices + offset for p in (ICT_SMILE, ICT_JAW_OPEN))
    frames = [moved, (moved + smile) / 2, smile]
    document, values = parse(
        write_glb(file, targets={"smile": smile, "jaw": jaw}, frames=frames, seconds=2.0)
    )
    mesh = document["meshes"][0]
    names = ["smile", "jaw", "frame-0000", "frame-0001", "frame-0002"]
    assert mesh["extras"]["targetNames"] == names
    assert mesh["weights"] == [0] * 5
    primitive = mesh["primitives"][0]
    centre = np.array(document["nodes"][0]["translation"])
    base = values[primitive["attributes"]["POSITION"]].astype(float)
    assert np.array_equal(values[primitive["indices"]].reshape(-1, 3), file.mesh.faces)
    for target, shape in zip(primitive["targets"], [smile, jaw, *frames], strict=True):
        assert np.abs(base + values[target["POSITION"]] + centre - shape).max() < 3e-6
    normals = values[primitive["attributes"]["NORMAL"]]
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)


def test_the_animation_fades_each_frame_into_the_next() -> None:
    file = read_mesh(ICT_NEUTRAL)
    smile = read_mesh(ICT_SMILE).mesh.vertices
    frames = [file.mesh.vertices, smile, file.mesh.vertices, smile]
    document, values = parse(write_glb(file, targets={"smile": smile}, frames=frames, seconds=3.0))
    (animation,) = document["animations"]
    (channel,), (sampler,) = animation["channels"], animation["samplers"]
    assert channel["target"] == {"node": 0, "path": "weights"}
    assert sampler["interpolation"] == "LINEAR"
    assert values[sampler["input"]].tolist() == [0, 1, 2, 3]
    weights = values[sampler["output"]].reshape(4, 5)
    assert np.array_equal(weights, np.hstack([np.zeros((4, 1)), np.eye(4)]))


def test_no_targets_and_no_frames_make_a_plain_mesh() -> None:
    document, _ = parse(write_glb(read_mesh(ICT_NEUTRAL), targets={}, frames=[]))
    assert not document.get("animations")
    assert not document["meshes"][0]["primitives"][0].get("targets")
