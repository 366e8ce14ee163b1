import subprocess
import sys

import engine


def test_every_public_name_is_there_and_nothing_else_is_promised() -> None:
    assert [name for name in engine.__all__ if getattr(engine, name, None) is None] == []
    assert sorted(engine.__all__) == sorted(engine._MODULES)


def test_errors_do_not_wait_for_the_solvers() -> None:
    script = "import engine.errors, sys; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
