"""What runs in a child process: read files, call the engine, write results."""

from service.jobs.editing import run_edit
from service.jobs.inspection import inspect_mesh, snap_points, validate_edit

__all__ = ["inspect_mesh", "run_edit", "snap_points", "validate_edit"]
