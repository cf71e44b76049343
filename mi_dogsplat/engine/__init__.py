"""The splatting engine on Dr.Jit: project, bin into tiles, composite, and all of it backwards."""
