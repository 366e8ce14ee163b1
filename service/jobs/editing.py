"""One edit, from files to files."""

from __future__ import annotations

import hashlib
from importlib.metadata import version
from typing import Any

from engine.io import MeshFile, read_mesh
from engine.pipeline import edit
from service.jobs.cache import StageCache
from service.jobs.outputs import Outputs, write_figures, write_meshes
from service.jobs.plans import engine_plan
from service.jobs.reports import report_document
from service.jobs.stages import JobStages
from service.jobtypes import EditJob, Report, ResultFile
from service.schemas import EditDocument


def run_edit(job: EditJob, report: Report) -> list[ResultFile]:
    """Do the edit and write its results into ``job.out``; raises the engine's errors."""
    document = EditDocument.model_validate(job.document)
    plan = engine_plan(document)
    engine_version = version("quasiface")
    stages = JobStages(report, StageCache(job.cache, engine_version))
    source, targets, inputs = stages.run("read", "", lambda: _read(job, document))
    stages.finish("read")
    done = edit(source, targets, plan, stages=stages)
    outputs = Outputs(job.out)
    single = document.frames is None and document.keyframes is None
    stages.run("write", "", lambda: _write(outputs, done, source, document, single=single))
    described = report_document(done, plan, source, inputs, stages.list(), engine_version)
    outputs.write_document("report.json", "report", described)
    stages.run("write", "", lambda: outputs.bundle("bundle.zip"))
    stages.finish_all()
    return outputs.files


def _read(
    job: EditJob, document: EditDocument
) -> tuple[MeshFile, dict[str, MeshFile], dict[str, Any]]:
    inputs: dict[str, Any] = {"source": _identity(job, document.source), "targets": {}}
    targets: dict[str, MeshFile] = {}
    for target in document.targets:
        targets[target.name] = read_mesh(job.meshes[target.mesh])
        inputs["targets"][target.name] = _identity(job, target.mesh)
    return read_mesh(job.meshes[document.source]), targets, inputs


def _identity(job: EditJob, mesh: str) -> dict[str, str]:
    with job.meshes[mesh].open("rb") as file:
        return {"mesh": mesh, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}


def _write(
    outputs: Outputs, done: Any, source: MeshFile, document: EditDocument, *, single: bool
) -> None:
    write_meshes(outputs, done, source, document.output.formats, single=single)
    write_figures(outputs, done)
