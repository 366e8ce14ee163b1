"""One edit, from files to files."""

from __future__ import annotations

import hashlib
from importlib.metadata import version
from typing import Any

from engine.io import MeshFile, read_mesh
from engine.pipeline import edit
from service.jobs.cache import StageCache
from service.jobs.findings import unit_guess
from service.jobs.outputs import Outputs, write_figures, write_meshes
from service.jobs.plans import engine_plan
from service.jobs.reports import Inputs, report_document
from service.jobs.stages import JobStages
from service.jobtypes import EditJob, Report, ResultFile
from service.schemas import EditDocument


def run_edit(job: EditJob, report: Report) -> list[ResultFile]:
    """Do the edit and write its results into ``job.out``; raises the engine's errors."""
    document = EditDocument.model_validate(job.document)
    plan = engine_plan(document)
    engine_version = version("quasiface")
    stages = JobStages(report, StageCache(job.cache, engine_version))
    inputs = stages.run("read", "", lambda: _read(job, document))
    stages.finish("read")
    done = edit(inputs.source, inputs.targets, plan, stages=stages)
    outputs = Outputs(job.out)
    single = document.frames is None and document.keyframes is None
    stages.run("write", "", lambda: _write(outputs, done, inputs.source, document, single=single))
    described = report_document(done, plan, inputs, stages.list(), engine_version)
    outputs.write_document("report.json", "report", described)
    stages.run("write", "", lambda: outputs.bundle("bundle.zip"))
    stages.finish_all()
    return outputs.files


def _read(job: EditJob, document: EditDocument) -> Inputs:
    source = read_mesh(job.meshes[document.source])
    targets = {target.name: read_mesh(job.meshes[target.mesh]) for target in document.targets}
    described = {
        "source": _described(job, document.source, source),
        "targets": {
            target.name: _described(job, target.mesh, targets[target.name])
            for target in document.targets
        },
    }
    return Inputs(source, targets, described)


def _described(job: EditJob, mesh: str, file: MeshFile) -> dict[str, str]:
    digest = hashlib.sha256(file.source).hexdigest()
    return {"mesh": mesh, "sha256": digest, "unit_guess": unit_guess(file)}


def _write(
    outputs: Outputs, done: Any, source: MeshFile, document: EditDocument, *, single: bool
) -> None:
    write_meshes(outputs, done, source, document.output.formats, single=single)
    write_figures(outputs, done)
