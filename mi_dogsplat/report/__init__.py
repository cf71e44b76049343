"""A run, told in one self-contained HTML page: curves, views, prunes, the mixture."""
