"""What becomes of accepted edits while the service's processes are killed with -9 at random.

``python -m benchmarks.kills 200``: API, workers, zygotes, children, database, or everything at
once, at random moments, while edits come in over HTTP. Needs no other service on the machine.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from tests.service.killing import PARTS, Stack, kill_at_random, running, tally


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("kills", type=int, nargs="?", default=200)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--pause", type=float, nargs=2, default=(0.2, 2.5))
    options.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as folder, running(Stack(Path(folder))) as stack:
        kills, accepted = kill_at_random(
            stack, chosen.kills, tuple(chosen.pause), chosen.seed, chosen.parts
        )
        print(tally(stack, kills, accepted, 600.0))


if __name__ == "__main__":
    main()
