import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_the_library_example_runs_as_printed(tmp_path: Path) -> None:
    (example,) = re.findall(
        r"<!-- tested -->\n```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL
    )
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    done = subprocess.run(
        [sys.executable, "-c", example], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("folds: 0")
    neutral = (ROOT / "examples/ict_face/A_neutral.ply").stat().st_size
    assert (tmp_path / "demo-out/smile-70.ply").stat().st_size == neutral
