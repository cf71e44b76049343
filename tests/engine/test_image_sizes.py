"""The kernels of an image size serve every other one: who resizes a viewport does not wait for a compiler."""

import drjit as dr
import mitsuba as mi
import pytest
from launches import KernelWatch
from mi_dogsplat.engine.aovs import AOVS
from splat_scenes import random_splats, rounded, scene_of, square_camera

SIZES = (64, 48), (97, 30), (20, 75)  # with part of a tile on either side, or neither


def drawn(scene: mi.Scene) -> None:
    dr.eval(mi.render(scene))


def differentiated(scene: mi.Scene) -> None:
    params = mi.traverse(scene)
    values = params["splats.logit_opacities"]
    dr.enable_grad(values)
    params.update()
    dr.backward(dr.sum(mi.render(scene, params).array))
    dr.eval(dr.grad(values))


@pytest.mark.parametrize(("run", "aovs"), [(drawn, ""), (drawn, ",".join(AOVS)), (differentiated, "")],
                         ids=["picture", "AOVs", "gradients"])
def test_another_size_needs_no_new_kernel(run, aovs):
    splats = rounded(random_splats(50, degree=0))
    with KernelWatch() as kernels:
        for width, height in SIZES:
            kernels.forget()
            run(scene_of(splats, square_camera(width, height), **({"aovs": aovs} if aovs else {})))
    assert kernels.launched and kernels.new == []
