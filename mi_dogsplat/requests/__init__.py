"""Pictures for another program, such as Blender, that asks for them in JSON and gets arrays."""
