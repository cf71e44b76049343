"""Masks of what stands in some photographs and is no part of the scene."""
