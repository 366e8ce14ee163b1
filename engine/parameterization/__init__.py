"""Surface to disk: bijective maps onto the unit disk, and the disk's own automorphisms."""

from engine.parameterization._automorphism import DiskAutomorphism, align_disk
from engine.parameterization._disk_map import disk_map

__all__ = ["DiskAutomorphism", "align_disk", "disk_map"]
