"""Compact Gaussian splatting methods under one renderer, one densified start, one budget."""
