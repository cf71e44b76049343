"""Rays, and scenes in which splats and surfaces light each other, beside the path-traced truth."""
