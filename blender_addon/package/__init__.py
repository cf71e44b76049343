"""The package ``mi_dogsplat`` for the add-on: inside of Blender's own Python, or its command as another process."""
