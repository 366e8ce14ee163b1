"""Back to 3D: the source's triangulation and details in the edited shape."""

from engine.restoration._beyond import Extrapolator
from engine.restoration._blend import Blender, blend
from engine.restoration._carry import Grip, Restorer
from engine.restoration._contact import Contacts
from engine.restoration._following import Carried, Follower
from engine.restoration._paper import restore_paper
from engine.restoration._restore import restore
from engine.restoration._turned import Orientation, turned_faces
from engine.restoration._weights import PointWeights, vertex_weights

__all__ = [
    "Blender",
    "Carried",
    "Contacts",
    "Extrapolator",
    "Follower",
    "Grip",
    "Orientation",
    "PointWeights",
    "Restorer",
    "blend",
    "restore",
    "restore_paper",
    "turned_faces",
    "vertex_weights",
]
