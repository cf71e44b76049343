"""The surface of splats as a mesh, by the package: a proxy for bodies, collisions and shadow catchers."""
