"""A prepared view: the same picture whatever else it is prepared for."""

from dataclasses import replace

import numpy as np
import pytest
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.bands import BandedView, PreparedView, WalkableView
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import Blocks
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.view import prepare, prepare_both
from mi_dogsplat.engine.walks.composite import composite
from splat_scenes import random_splats, rounded, tilted_camera

PARAMS = rounded(random_splats(200, seed=9, degree=1))
OPTIONS = RasterOptions(1)


def camera() -> DeviceCamera:
    return DeviceCamera.upload(tilted_camera(70, 50))


def planes(view: WalkableView) -> np.ndarray:
    blended = composite(view)
    return np.stack([plane.numpy() for plane in [*blended.features, blended.T]])


def overlapping() -> Blocks:
    own = Blocks.of_backend()
    return replace(own, width=own.width + 1, height=own.height + 1, overlap=1)


def flat() -> Blocks:
    return replace(Blocks.of_backend(), height=1)


@pytest.mark.parametrize("blocks", [Blocks.of_backend, overlapping, flat])
def test_a_view_prepared_twice_is_the_picture_of_one_prepared_once(blocks):
    pictured, other = prepare_both(upload(PARAMS), camera(), OPTIONS, blocks())
    assert other.grid.blocks == blocks()
    expected = planes(prepare(upload(PARAMS), camera(), OPTIONS))
    np.testing.assert_array_equal(planes(pictured), expected)
    if not blocks().overlap:  # else two lanes would write the same pixel
        np.testing.assert_allclose(planes(other), expected, atol=2e-6)  # patches that begin elsewhere round otherwise


def test_lists_are_made_once_where_the_tiles_are_in_the_same_places():
    for blocks, shared in ((Blocks.of_backend, True), (overlapping, True), (flat, False)):
        pictured, other = prepare_both(upload(PARAMS), camera(), OPTIONS, blocks())
        assert isinstance(pictured, PreparedView) and isinstance(other, PreparedView)
        assert (pictured.lists is other.lists) == shared and pictured.tables is other.tables


def test_without_memory_a_view_is_in_bands_where_isects_have_sums_of_their_own():
    view = prepare(upload(PARAMS), camera(), replace(OPTIONS, isect_memory=0))
    both = prepare_both(upload(PARAMS), camera(), replace(OPTIONS, isect_memory=0), flat())
    assert [isinstance(one, BandedView) for one in (view, *both)] == 3 * [array_types().is_llvm]
    np.testing.assert_array_equal(planes(view), planes(prepare(upload(PARAMS), camera(), OPTIONS)))


def test_a_choice_of_the_options_reaches_the_kernels():
    params, plain = upload(PARAMS), planes(prepare(upload(PARAMS), camera(), OPTIONS))
    for options in (replace(OPTIONS, negative_transmittance=False), replace(OPTIONS, antialiased=True)):
        assert not np.array_equal(planes(prepare(params, camera(), options)), plain)


@pytest.mark.parametrize("degree", [0, 1])
def test_a_view_of_nothing_is_refused(degree):
    nothing = upload(PARAMS.select(np.zeros(200, bool)))
    with pytest.raises(ValueError, match="no primitive"):
        prepare(nothing, camera(), RasterOptions(degree))
    with pytest.raises(ValueError, match="no primitive"):
        prepare_both(nothing, camera(), RasterOptions(degree), Blocks.of_backend())
