"""What is given to others: the wheel, the Blender extension, and the reference of the Python interface."""
