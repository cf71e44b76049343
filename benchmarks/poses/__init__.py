"""Cameras: found, refined, upright, and in metres, beside those that are known."""
