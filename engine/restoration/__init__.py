"""Back to 3D: the source's triangulation and details in the edited shape."""

from engine.restoration._blend import Blender, blend
from engine.restoration._carry import Restorer
from engine.restoration._turned import turned_faces

__all__ = ["Blender", "Restorer", "blend", "turned_faces"]
