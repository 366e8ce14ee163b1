"""Topology: boundary loops, the surface to edit, and the disk that stands for it in the plane."""

from engine.topology._collar import with_collar
from engine.topology._component_kernels import lowest_in_component
from engine.topology._counts import TopologyCounts, topology_counts, used_vertices
from engine.topology._disk import disk_surface, filled_disk
from engine.topology._editable import editable_surface
from engine.topology._loops import boundary_loops
from engine.topology._welding import position_classes

__all__ = [
    "TopologyCounts",
    "boundary_loops",
    "disk_surface",
    "editable_surface",
    "filled_disk",
    "lowest_in_component",
    "position_classes",
    "topology_counts",
    "used_vertices",
    "with_collar",
]
