"""Numbers that two kernels or two runs must agree on: to the bit on CPUs, up to rounding on a GPU."""

import numpy as np
from mi_dogsplat.engine.arrays import array_types

UNITS = 16  # in the last place of the largest number; an H100 needed 4


def assert_same_numbers(got: np.ndarray, expected: np.ndarray | float) -> None:
    """Equal bits on LLVM; on CUDA a few units in the last place, in float32, of the largest number.

    The compiler of CUDA may make one rounding of a product and its sum, and does so in one kernel but not in another;
    it approximates quotients and functions; and atomics add in any order. A term is rounded by its own size, so what
    its sum may be off does not shrink with the sum. A picture [H, W, C] has a largest number for each channel.
    """
    got, expected = np.broadcast_arrays(got, expected)
    if array_types().is_llvm:
        np.testing.assert_array_equal(got, expected)
        return
    channels = (np.moveaxis(x, -1, 0) if x.ndim == 3 else x[None] for x in (got, expected))
    for k, (a, b) in enumerate(zip(*channels, strict=True)):
        atol = UNITS * np.spacing(np.float32(np.abs(b).max(initial=0)))
        np.testing.assert_allclose(a, b, rtol=0, atol=atol, err_msg=f"channel {k}")
