"""Models as Blender objects: attributes, import, export."""
