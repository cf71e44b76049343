"""Models made smaller by hand: what is not needed or not wanted leaves, what is near and alike becomes one."""
