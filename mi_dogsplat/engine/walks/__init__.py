"""The kernels that walk down the lists of a prepared view: to blend it, or to replay the blending for other sums."""
