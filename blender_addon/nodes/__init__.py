"""The Geometry Nodes and materials that draw splats."""
