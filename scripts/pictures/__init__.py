"""Pictures of the documentation, but for those by Blender."""
