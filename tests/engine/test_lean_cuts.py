"""Nothing is paid for cuts or curvatures where none is: shown in kernels, by their hashes and instructions."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from launches import kernels as launched_kernels
from lean_calls import backward, forget_recordings, forward, stages
from mi_dogsplat.engine.curvatures import curved_slope
from mi_dogsplat.engine.walks import block_sums, tangents, walk
from mi_dogsplat.scene.row_groups import CUTS, PLANES, SECOND_CUTS, RowGroup
from mi_dogsplat.scene.splats import Splats
from sloped_models import with_curvatures
from splat_scenes import kernels, random_splats, rounded

pytestmark = pytest.mark.usefixtures("fresh_recordings", "small_blocks")
KINDS = {"plain": (0, 0), "DoG": (0.5, 0), "slopes": (0, 0.5), "DoG, slopes": (0.5, 0.5)}
CURVED = "DoG, slopes, curvatures"


def model(kind: str) -> Splats:
    if kind == CURVED:
        return with_curvatures(model("DoG, slopes"), every=3)
    return rounded(random_splats(200, 0, 0, *KINDS[kind]))


def cut(splats: Splats, *planes: RowGroup) -> Splats:
    """By these planes, or by the first."""
    index = np.arange(0, splats.n_splats, 2)
    for seed, plane in enumerate(planes or (CUTS,), 1):
        rows = {name: np.random.default_rng(seed).normal(0, 3, (len(index), 3)) for name in plane.names}
        splats = replace(splats, **{plane.index: index}, **rows)
    return splats


def hashes(run: Callable[[], Any]) -> set[str]:
    """Of all kernels of a call that replays nothing; what a process computes once has been before."""
    run()
    forget_recordings()
    return kernels(run)


@pytest.mark.parametrize("run", [forward, backward])
@pytest.mark.parametrize("kind", [*KINDS, CURVED])
def test_a_model_without_cuts_has_the_kernels_of_one_that_never_had_any(kind, run):
    splats = model(kind)
    expected = hashes(run(splats))
    assert hashes(run(cut(splats).without_cuts())) == expected
    no_row = replace(splats, cut_index=np.zeros(0, np.uint32), cut_normals=np.zeros((0, 3)))
    assert hashes(run(no_row)) == expected
    assert hashes(run(cut(splats))) != expected


@pytest.mark.parametrize("run", [forward, backward])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("planes", [(), PLANES], ids=["whole", "cut twice"])
def test_a_model_without_curvatures_has_the_kernels_of_one_that_never_had_any(planes, kind, run):
    splats = cut(model(kind), *planes) if planes else model(kind)
    expected = hashes(run(splats))
    assert hashes(run(with_curvatures(splats).without_curvatures())) == expected
    no_row = replace(splats, curvature_index=np.zeros(0, np.uint32), brightness_curvatures=np.zeros((0, 6)))
    assert hashes(run(no_row)) == expected
    assert hashes(run(with_curvatures(splats))) != expected


@pytest.mark.parametrize("run", [forward, backward])
def test_a_model_cut_off_by_either_plane_alone_has_the_kernels_of_one_plane(run):
    """And another for both; a row of no primitive changes none."""
    splats = model("DoG, slopes")
    expected = hashes(run(cut(splats)))
    assert hashes(run(cut(splats, SECOND_CUTS))) == expected
    twice = cut(splats, *PLANES)
    assert hashes(run(twice.without_second_cuts())) == expected
    assert hashes(run(twice)) != expected


@pytest.mark.parametrize("kind", KINDS)
def test_curvatures_take_no_kernel_more_and_work_for_primitives_and_blocks_alone(kind):
    without, curved = forward(model(kind)), forward(with_curvatures(model(kind)))
    assert len(launched_kernels(curved)) == len(launched_kernels(without))
    costs = stages(without), stages(curved)
    assert {stage for stage, least in costs[0].items() if costs[1][stage] > least} == {"primitives", "compositor"}


@pytest.mark.parametrize("kind", [*KINDS, CURVED])
@pytest.mark.parametrize(("fewer", "more"), [((), (CUTS,)), ((CUTS,), PLANES)], ids=["one plane", "a second"])
def test_cuts_take_no_kernel_more_and_work_for_primitives_and_blocks_alone(kind, fewer, more):
    """With DoG and cuts the compositor's code is of fewer primitives per iteration."""
    splats = model(kind)
    without, with_cuts = forward(cut(splats, *fewer) if fewer else splats), forward(cut(splats, *more))
    assert len(launched_kernels(with_cuts)) == len(launched_kernels(without))
    costs = stages(without), stages(with_cuts)
    assert {stage for stage, least in costs[0].items() if costs[1][stage] != least} == {"primitives", "compositor"}


def test_a_forward_pass_does_not_evaluate_what_derivatives_alone_need(monkeypatch):
    """How steep a cut falls at a pixel costs an operation per pixel, which a picture has no use for."""
    whole = walk.all_kept

    def without_falls(*given):
        found = whole(*given)
        for plane in found:
            plane.falls = plane.values
        return found

    expected = [stages(forward(cut(model("plain"), *planes))) for planes in ((CUTS,), PLANES)]
    monkeypatch.setattr(walk, "all_kept", without_falls)
    forget_recordings()
    assert [stages(forward(cut(model("plain"), *planes))) for planes in ((CUTS,), PLANES)] == expected


def test_how_steep_a_brightness_is_at_a_pixel_is_for_derivatives_alone(monkeypatch):
    """A picture has no use for it either; a backward pass asks for it where there are curvatures."""
    asked = []

    def watched(*given):
        asked.append(given)
        return curved_slope(*given)

    for module in (block_sums, tangents, walk):
        monkeypatch.setattr(module, "curved_slope", watched, raising=False)
    forget_recordings()
    forward(model(CURVED))()
    backward(model("DoG, slopes"))()
    assert not asked
    backward(model(CURVED))()
    assert asked
