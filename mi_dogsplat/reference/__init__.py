"""The float64 twins: each stage of the engine, its gradients, scores and AOVs once more in plain NumPy."""

from .forward import (
           MAX_ALPHA,
           MIN_T,
           RAW_PARAMETERS,
           composite,
           depth_order,
           kernels,
           loss_gradients,
           pixel_centres,
           render,
           tiles,
)
from .projection import LOW_PASS, MIN_ANTIALIAS_RATIO, project, sh_basis
from .quaternions import rotations

__all__ = ["LOW_PASS", "MAX_ALPHA", "MIN_ANTIALIAS_RATIO", "MIN_T", "RAW_PARAMETERS", "composite", "depth_order",
           "kernels", "loss_gradients", "pixel_centres", "project", "render", "rotations", "sh_basis", "tiles"]
