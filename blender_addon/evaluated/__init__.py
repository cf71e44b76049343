"""Splats as Blender's dependency graph has them: edited by modifiers, placed by objects and instances."""
