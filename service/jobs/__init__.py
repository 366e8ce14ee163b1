"""What runs in a child process: read files, call the engine, write results."""

from engine._jit import load_kept_kernels
from service.jobs.editing import keep_open, run_edit
from service.jobs.inspection import inspect_mesh, snap_points, validate_edit

__all__ = [
    "inspect_mesh",
    "keep_open",
    "load_kept_kernels",
    "run_edit",
    "snap_points",
    "validate_edit",
]
