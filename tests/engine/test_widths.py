"""Packets of 8 and 4 lanes, as processors without AVX-512 have them: the same pictures, and the same bits in every run.

This machine compiles and runs the code of such a processor in a process of its own.
"""

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.drjit_internals import llvm_packet
from mi_dogsplat.engine.geometry import Blocks
from mi_dogsplat.support.llvm import find_llvm
from packet_process import in_process, picture_and_gradients

from benchmarks.processors.targets import can_build, environment

LLVM = (mi.variant() or "").startswith("llvm")


@pytest.mark.skipif(not LLVM, reason="a warp has 32 lanes everywhere; use llvm_ad_rgb")
def test_a_tile_has_a_lane_for_each_of_a_packet():
    assert Blocks.of_backend().lanes_per_tile == llvm_packet()


@pytest.mark.slow
@pytest.mark.usefixtures("all_cores")
@pytest.mark.skipif(not LLVM, reason="compares with LLVM's code for other processors; use llvm_ad_rgb")
@pytest.mark.parametrize("target, lanes", [("avx2", 8), ("sse", 4)])
def test_narrower_packets_give_the_same_picture_and_gradients_with_the_same_bits_in_every_run(target, lanes, tmp_path):
    if find_llvm() is None or not can_build():
        pytest.skip("needs Linux on x86-64 with a usable LLVM and a C compiler: it makes a library that wraps it")
    if llvm_packet() <= lanes:
        pytest.skip("the packets of this processor are no wider")
    found, expected = in_process(environment(target, tmp_path), tmp_path), picture_and_gradients()
    assert found["packet"] == lanes and found["in_turn"] and found["same_bits"]
    np.testing.assert_allclose(found["planes"], expected["planes"], rtol=0, atol=4e-6)
    for name in expected.keys() - {"planes"}:
        assert np.abs(expected[name]).max() > 0
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-4, atol=1e-5 * np.abs(expected[name]).max())
