"""A model as pictures: from Python, and to files."""
