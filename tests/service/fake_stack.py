"""``quasiface serve`` with workers whose edits are a function of ``fake_jobs``."""

import sys

from service import logs
from service.processes import end_quickly
from service.settings import Settings
from service.supervisor import Supervisor

if __name__ == "__main__":
    end_quickly()
    settings = Settings()
    logs.configure(settings.log_level)
    Supervisor(settings, worker=("tests.service.fake_worker", *sys.argv[1:])).run()
