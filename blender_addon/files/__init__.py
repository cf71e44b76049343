"""Models as numbers and files; nothing here knows Blender."""
