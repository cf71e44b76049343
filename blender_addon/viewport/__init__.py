"""Viewports: what they show while they move, made for their view, and how our engine draws them."""
