"""What a scene is made of, in memory and in files: primitives and cameras. Needs NumPy only."""
