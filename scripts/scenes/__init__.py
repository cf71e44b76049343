"""Models for ``scenes/``, captured and trained where they stand."""
