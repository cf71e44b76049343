"""Models as Blender's data: attributes of a mesh or of a point cloud, and what objects remember of their file."""
