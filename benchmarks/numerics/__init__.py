"""Stiffness, derivatives, popping, and what a number that is not finite does."""
