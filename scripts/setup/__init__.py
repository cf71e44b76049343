"""What is fetched and installed: environments, LLVM, Blender, weights of LPIPS, and the viewer that goes into pages."""
