"""The rivals, one file each: what it scores or learns, when it prunes, and where that comes from."""
