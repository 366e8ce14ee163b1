"""One edit, from files to files; and edits that start from one that is kept open."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from importlib.metadata import version
from typing import Any

from engine.errors import EngineError
from engine.io import MeshFile, read_mesh
from engine.pipeline import Edit, EditedMeshes, EditPlan, open_edit
from engine.raster import Canvas
from service.jobs.cache import StageCache
from service.jobs.findings import unit_guess
from service.jobs.outputs import Outputs, write_figures, write_meshes
from service.jobs.pictures import source_plane
from service.jobs.plans import engine_plan, moved_plan
from service.jobs.reports import Inputs, report_document, source_places
from service.jobs.stages import JobStages
from service.jobtypes import EditJob, Json, Report, ResultFile, Work
from service.schemas import EditDocument


def run_edit(job: EditJob, report: Report) -> list[ResultFile]:
    """Do the edit and write its results into ``job.out``; raises the engine's errors."""
    document = EditDocument.model_validate(job.document)
    return _Opened(job, document, engine_plan(document), report).follow(job, document, report)


def keep_open(job: EditJob) -> Work:
    """``run_edit`` for edits like ``job`` (see ``service.openings``), all they share done already.

    One such edit is done on the way, into ``job.out``: much is made when it is first needed.
    """
    document = EditDocument.model_validate(job.document)
    plan = engine_plan(document)
    opened = _Opened(job, document, plan, _silent)
    names = [target.name for target in document.targets]
    between = {name: 0.5 / len(names) for name in names}
    plan = replace(plan, weights=between, distances={}, frames=None, keyframes=())
    output = document.output.model_copy(update={"figures": True})
    opened.write(job, document.model_copy(update={"output": output}), plan, _silent)
    opened.prepare()
    return opened.run


class _Opened:
    """An edit that is open, the files that it came from, and its stages."""

    def __init__(
        self, job: EditJob, document: EditDocument, plan: EditPlan, report: Report
    ) -> None:
        self._version = version("quasiface")
        self._stages = JobStages(report, StageCache(job.cache, self._version))
        self._inputs = self._stages.run("read", "", lambda: _read(job, document))
        self._stages.finish("read")
        source, targets = self._inputs.source, self._inputs.targets
        self._edit = open_edit(source, targets, plan, stages=self._stages)
        self._plane: Canvas | None = None
        self._places: list[Json] = []

    def run(self, job: EditJob, report: Report) -> list[ResultFile]:
        """Another edit, from here; once, in a process of its own."""
        document = EditDocument.model_validate(job.document)
        self._stages.again(report)
        return self.follow(job, document, report)

    def follow(self, job: EditJob, document: EditDocument, report: Report) -> list[ResultFile]:
        """Do the edit from here; where the planes cannot follow its points, from the beginning."""
        plan = moved_plan(document, engine_plan(document))
        try:
            return self.write(job, document, plan, report)
        except EngineError as error:
            if error.code != "other_edit":
                raise
        return _Opened(job, document, plan, report).write(job, document, plan, report)

    def prepare(self) -> None:
        """Make what points need to be moved on targets."""
        self._edit.prepare()

    def write(
        self, job: EditJob, document: EditDocument, plan: EditPlan, report: Report
    ) -> list[ResultFile]:
        """Do what ``plan`` says and write the results."""
        wanted, stages = document.output, self._stages
        done = self._edit.edit(plan) if wanted.figures else self._edit.meshes(plan)
        outputs = Outputs(job.out, report)
        stages.run("write", "", lambda: self._write(outputs, done, document))
        self._places = self._places or source_places(done, self._inputs.source)
        described = report_document(
            done, plan, self._inputs, self._places, stages.list(), self._version
        )
        outputs.write_document("report.json", "report", described)
        if wanted.figures:
            stages.run("write", "", lambda: outputs.bundle("bundle.zip"))
        stages.finish_all()
        return outputs.files

    def _write(self, outputs: Outputs, done: EditedMeshes, document: EditDocument) -> None:
        single = document.frames is None and document.keyframes is None
        formats = document.output.formats
        write_meshes(outputs, done, self._inputs.source, formats, single=single)
        if isinstance(done, Edit):
            self._plane = self._plane or source_plane(done)
            write_figures(outputs, done, self._plane)


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


def _silent(event: dict[str, Any]) -> None:
    """Nobody listens."""
