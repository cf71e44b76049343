"""Splats that Blender draws itself, from 5.3 on: to them and back."""
