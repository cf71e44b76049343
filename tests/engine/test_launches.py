"""What a pass asks the device for besides its kernels: no sort on CUDA, no copies, few launches."""

import itertools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from launches import launches
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.frozen import frozen, zeros_for
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from splat_scenes import attached, random_splats, rounded, square_camera

CAMERA = square_camera(64, 48)


def pass_of_any_size():
    """Forward and backward, of one primitive more in each call."""
    camera, counts = DeviceCamera.upload(CAMERA), itertools.count(100)
    δ = [mi.Float(np.random.default_rng(c).normal(size=64 * 48)) for c in range(3)]
    dr.make_opaque(δ)

    def run():
        params = attached(rounded(random_splats(next(counts), dog_share=0, degree=0)))
        dr.eval(params)
        planes = rasterize(params, camera, RasterOptions(sh_degree=0)).colors
        for plane, value in zip(planes, δ, strict=True):
            dr.set_grad(plane, value)
        dr.enqueue(dr.ADMode.Backward, planes)
        dr.traverse(dr.ADMode.Backward)
        dr.eval([dr.grad(value) for value in params.values()])

    return run


def test_no_array_is_copied():
    """The rows of adjoints would be, were they an argument of the kernel that adds to them."""
    if not array_types().is_llvm:
        pytest.skip("Dr.Jit's history has no copies on CUDA; python -m benchmarks launches counts them in a driver")
    copied = [launch.size for launch in launches(pass_of_any_size()) if launch.kind == "Memcpy"]
    assert copied == [4]  # bytes: the number of isects, to the host


def test_cuda_sorts_nothing_and_launches_little():
    if array_types().is_llvm:
        pytest.skip("CPUs sort, which is a launch of threads that wait for it")
    kinds = [launch.kind for launch in launches(pass_of_any_size())]
    assert set(kinds) == {"JIT", "BlockPrefixReduce"}
    # the projection, its rows; six for lists; the compositor, its planes; sums, its derivative; their columns, and the
    # derivative of the projection
    assert len(kinds) == 14


def test_zeros_in_a_frozen_function_are_as_many_as_the_arguments_of_a_call_ask_for():
    UInt = array_types().UInt

    @frozen
    def rows(values):
        table = zeros_for(values, 12)
        dr.scatter_add(table, array_types().Float(1), dr.arange(UInt, dr.width(values)) * 12 + 11)
        return table

    for n in (50, 51, 7, 2000, 1):
        values = dr.opaque(UInt, 4_000_000_000, n)
        np.testing.assert_array_equal(rows(values).numpy().reshape(n, 12).sum(0), [0] * 11 + [n])
