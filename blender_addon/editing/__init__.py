"""Operators that edit splats: crop, limits, painting, making edits real, joining, transforms."""
