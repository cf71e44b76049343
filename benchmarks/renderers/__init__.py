"""The same splats in other renderers: their times, and what they draw."""
