"""Tests share the cores: threads of linear algebra in each of them would only wait for another."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
