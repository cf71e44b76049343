"""A model that is trained on the grids of the file it will be in."""
