"""The scene around the splats for Mitsuba: evaluated meshes, lights, world, materials and camera as JSON and arrays."""
