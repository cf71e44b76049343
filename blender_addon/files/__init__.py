"""Models as numbers and files; of Blender nothing here knows more than the language of its messages."""
