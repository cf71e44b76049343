"""What Blender does for the documentation: pictures by it and of its window, and times."""
