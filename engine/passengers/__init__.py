"""What is in the file but not on the edited surface: eyeballs, teeth, tongue, lashes, debris."""

from engine.passengers._attach import Passengers, attach
from engine.passengers._carry import carry

__all__ = ["Passengers", "attach", "carry"]
