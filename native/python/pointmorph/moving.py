"""The old name of `pointmorph.moving_shapes`, for scripts that import it."""

from pointmorph.moving_shapes import MovingSequence, ShapeState

Pose = ShapeState

__all__ = ["MovingSequence", "Pose"]
