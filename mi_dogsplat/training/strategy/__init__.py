"""What a training does to the number and the kind of its primitives: densify, prune, make DoG, sieve."""
