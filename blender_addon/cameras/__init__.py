"""Cameras of data sets: read, as Blender objects, and the operators on them."""
