"""A worker process whose edits are a function of ``fake_jobs``."""

import asyncio
import sys

from service.processes import end_quickly
from service.settings import Settings
from service.worker_process import run_worker

if __name__ == "__main__":
    end_quickly()
    name = sys.argv[1] if len(sys.argv) > 1 else "edit"
    jobs = "tests.service.fake_jobs"
    asyncio.run(run_worker(Settings(), f"{jobs}:{name}", f"{jobs}:keep_{name}_open"))
