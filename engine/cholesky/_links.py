"""Array types of a graph that is to be ordered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Links = NDArray[np.int32]
"""Ends or strengths of a graph's edges: half of the memory, which the ordering waits for."""
