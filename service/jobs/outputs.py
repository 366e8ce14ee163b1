"""Result files of an edit: meshes, morphs, figures, plots, and the bundle of all of them."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic_core import from_json, to_json

from engine.io import MeshFile, write_glb, write_mesh
from engine.pipeline import Edit, EditedMeshes
from engine.raster import Canvas
from engine.types import FloatArray
from service.jobs.pictures import histogram_picture, plane_picture
from service.jobs.reports import histogram_document
from service.jobtypes import MEDIA_TYPES, Json, Report, ResultFile

SECONDS_PER_FRAME = 1.0 / 12.0
_FAST = 1  # of the levels of deflate
_DENSE = {MEDIA_TYPES["png"], MEDIA_TYPES["glb"], MEDIA_TYPES["ply"]}


@dataclass(frozen=True, slots=True)
class Shown:
    """One mesh to write: its name without ending, role, vertices (n, 3) and description."""

    stem: str
    role: Literal["mesh", "target_mesh"]
    vertices: FloatArray
    meta: dict[str, Any]


class Outputs:
    """Writes result files into one folder, reports each when it is complete, and remembers it."""

    def __init__(self, folder: Path, report: Report) -> None:
        self._folder = folder
        self._report = report
        self.files: list[ResultFile] = []

    def write(self, name: str, role: str, data: bytes, **meta: Any) -> None:
        """Write one result."""
        path = self._folder / name
        path.write_bytes(data)
        self._complete(name, role, path, meta)

    def write_document(self, name: str, role: str, document: object) -> None:
        """Write one JSON result; ``ValueError`` if a figure in it is not finite."""
        data = to_json(document)
        from_json(data, allow_inf_nan=False)
        self.write(name, role, data)

    def bundle(self, name: str) -> None:
        """All results so far in one archive; what deflates by little or nothing is only stored."""
        path = self._folder / name
        with zipfile.ZipFile(path, "w") as archive:
            for file in self.files:
                dense = file.media_type in _DENSE
                how = zipfile.ZIP_STORED if dense else zipfile.ZIP_DEFLATED
                entry = zipfile.ZipInfo.from_file(file.path, file.name)
                archive.writestr(entry, file.path.read_bytes(), how, _FAST)
        self._complete(name, "bundle", path, {})

    def _complete(self, name: str, role: str, path: Path, meta: Json) -> None:
        ending = name.rpartition(".")[2]
        self.files.append(ResultFile(name, role, MEDIA_TYPES[ending], path, meta))
        self._report({"type": "result", "path": path})


def shown_meshes(edit: EditedMeshes, single: bool) -> Iterator[Shown]:
    """Frames (or the one edited mesh), then the source carried to every target."""
    for frame in edit.frames:
        stem = "edited" if single else f"frame-{frame.index:04d}"
        meta: dict[str, Any] = {"weights": dict(frame.weights)}
        if not single:
            meta |= {"frame": frame.index}
        yield Shown(stem, "mesh", frame.vertices, meta)
    for target in edit.targets:
        yield Shown(
            f"target-{target.name}", "target_mesh", target.vertices, {"target": target.name}
        )


def write_meshes(
    outputs: Outputs, edit: EditedMeshes, file: MeshFile, formats: Sequence[str], *, single: bool
) -> None:
    """Every mesh in every format that was asked for, and the morph."""
    wanted: list[Literal["source", "obj", "ply"]] = [
        form for form in ("source", "obj", "ply") if form in formats
    ]
    for shown in shown_meshes(edit, single):
        for form in wanted:
            ending = file.format if form == "source" else form
            taken = form == file.format and "source" in wanted
            stem = f"{shown.stem}-clean" if taken else shown.stem
            data = write_mesh(file, shown.vertices, format=form)
            outputs.write(f"{stem}.{ending}", shown.role, data, **shown.meta)
    if "glb" in formats:
        morph = write_glb(
            file,
            targets={target.name: target.vertices for target in edit.targets},
            frames=[frame.vertices for frame in edit.frames],
            seconds=max(len(edit.frames) - 1, 1) * SECONDS_PER_FRAME,
        )
        outputs.write("morph.glb", "morph", morph)


def write_figures(outputs: Outputs, edit: Edit, begun: Canvas) -> None:
    """Histograms as figures and as a picture, and the picture of the planes, ``begun`` before."""
    last = edit.frames[-1]
    outputs.write_document("histogram.json", "histogram", histogram_document(edit))
    outputs.write("histogram.png", "histogram", histogram_picture(edit.source_to_disk, last))
    outputs.write("plane.png", "plane", plane_picture(edit, last, begun))
