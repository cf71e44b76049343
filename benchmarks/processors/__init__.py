"""Kernels on processors: instructions, vector widths, warps, launches and memory of the device."""
