"""Splats that Blender draws itself, from 5.3 on: plain Gaussians in a point cloud."""
