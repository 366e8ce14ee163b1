"""A worker process whose edits are ``fake_jobs:edit``."""

import asyncio

from service.settings import Settings
from service.worker_process import run_worker

if __name__ == "__main__":
    asyncio.run(run_worker(Settings(), "tests.service.fake_jobs:edit"))
