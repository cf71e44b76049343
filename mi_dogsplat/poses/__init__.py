"""Poses of photographs or of a video: structure from motion by pycolmap, into a COLMAP folder."""
