"""Bytes to mesh and back: PLY and OBJ read and patched in place, GLB written."""

from engine.io._colours import vertex_colours
from engine.io._mesh_file import MeshFile
from engine.io._read import read_mesh
from engine.io._write import write_mesh
from engine.io.gltf import write_glb

__all__ = ["MeshFile", "read_mesh", "vertex_colours", "write_glb", "write_mesh"]
