"""Any Blender scene to a compact model: a rig of cameras, their renders as a data set, and ``dogsplat train`` on it."""
