"""Where few primitives are DoG, the tiles that have none of them are blended by the loop of a plain model."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from launches import branches, launches, loop
from mi_dogsplat.engine import isects
from mi_dogsplat.engine.bands import PreparedView
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.view import prepare
from mi_dogsplat.engine.walks.composite import composite
from mi_dogsplat.scene.splats import Splats
from splat_scenes import make_splats, random_splats, rounded, square_camera

CAMERA = square_camera(64, 48)
N = isects.FEW_DOG
llvm_only = pytest.mark.skipif(
    not (mi.variant() or "").startswith("llvm"), reason="on CUDA a branch that no lane takes costs little"
)


def with_one_dog() -> Splats:
    """Splats of which one, small and in front of all others, is DoG."""
    seen = np.append((np.array([7, 7]) - (CAMERA.cx, CAMERA.cy)) / (CAMERA.fx, CAMERA.fy), [1, 1])
    one = rounded(make_splats((CAMERA.c2w @ seen)[:3], 0.02, 0.9, dog=[0]))
    others = rounded(random_splats(N, degree=0, dog_share=0))
    return Splats(**{name: np.concatenate([getattr(one, name), getattr(others, name)]) for name in vars(one)})


def prepared() -> PreparedView:
    view = prepare(upload(with_one_dog()), DeviceCamera.upload(CAMERA), RasterOptions(sh_degree=0))
    assert isinstance(view, PreparedView)
    dr.eval(view)
    return view


def image(view: PreparedView) -> np.ndarray:
    blended = composite(view)
    return np.stack([plane.numpy() for plane in (*blended.features, blended.T)])


@llvm_only
def test_the_tiles_of_a_dog_primitive_are_known():
    lists = prepared().lists
    assert lists.dog is not None
    begin, end, splat = (v.numpy() for v in (lists.begin, lists.end, lists.splat_from_isect))
    has_one = [0 in splat[b:e] for b, e in zip(begin, end, strict=True)]
    np.testing.assert_array_equal(lists.dog.numpy(), has_one)
    assert 0 < sum(has_one) < len(has_one)


@llvm_only
def test_a_loop_for_each_kind_of_tile_draws_what_one_for_all_draws(monkeypatch):
    split = prepared()
    monkeypatch.setattr(isects, "FEW_DOG", 2 * isects.FEW_DOG)
    whole = prepared()
    assert whole.lists.dog is None
    np.testing.assert_array_equal(image(split), image(whole))
    assert (image(split)[-1] < 1).any()
    both, one = (loop(launches(lambda view=view: dr.eval(composite(view)))).code for view in (split, whole))
    assert [code.count("Symbolic loop: composite") for code in (both, one)] == [2, 1]
    assert len(branches(both)) == len(branches(one)) > 0
