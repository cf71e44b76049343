"""What a file or a scene is, what it needs, and what is left out for it."""
