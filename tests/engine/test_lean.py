"""Nothing is paid for what a scene does not need: shown in the kernels, by their number and their instructions.

What is left out is compared with a renderer that never had it (``benchmarks/plain_renderer.py``), or with the same call
without it. Kernels are told apart by their size: a lane per primitive, per block of pixels, per pixel.
"""

import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import tiny_data
from changed_strategy import change_densification
from launches import branches, instructions, kernels, launches, loop
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.bands import PreparedView
from mi_dogsplat.engine.frozen import Frozen
from mi_dogsplat.engine.geometry import Blocks, Grid
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import DeviceCamera
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from mi_dogsplat.engine.view import prepare
from mi_dogsplat.engine.walks.aovs import WALKED
from mi_dogsplat.engine.walks.composite import composite
from mi_dogsplat.engine.walks.walk import Walk
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.photographs import Photographs
from mi_dogsplat.training.train import Trainer
from splat_scenes import (
    attached,
    dog_dict,
    make_splats,
    random_splats,
    rounded,
    scene_of,
    square_camera,
)
from splat_scenes import kernels as compiled
from tile_lists import lanes_of_isects

from benchmarks import plain_renderer

N, WIDTH, HEIGHT = 200, 64, 48
CAMERA = square_camera(WIDTH, HEIGHT)


def forget_recordings() -> None:
    """As in a new process: the calls before decide what a frozen function launches, and which equal expressions beside
    it Dr.Jit takes for one."""
    for name in [name for name in sys.modules if name.startswith("mi_dogsplat.")]:
        for value in list(vars(sys.modules[name]).values()):
            if isinstance(value, Frozen):
                value.clear()


@pytest.fixture(autouse=True)
def _after_other_tests():
    forget_recordings()


def model(degree=0, dog_share=0.0, seed=0) -> Splats:
    return rounded(random_splats(N, seed=seed, degree=degree, dog_share=dog_share))


def stages(run: Callable[[], Any]) -> dict[str, int]:
    """Operations of the kernels with a lane per primitive, per block of pixels, and per pixel."""
    blocks = Blocks.of_backend()
    lanes = Grid(WIDTH, HEIGHT, blocks).n_tiles * blocks.lanes_per_tile
    sizes = {N: "primitives", lanes: "compositor", WIDTH * HEIGHT: "image"}
    assert len(sizes) == 3
    sums = dict.fromkeys(sizes.values(), 0)
    for size, operations in kernels(run):
        if size in sizes:
            sums[sizes[size]] += operations
    return sums


def forward(splats: Splats, **options) -> Callable[[], Any]:
    params, camera = upload(splats), DeviceCamera.upload(CAMERA)
    chosen = RasterOptions(**{"sh_degree": splats.sh_degree, **options})

    def run():
        frame = rasterize(params, camera, chosen)
        dr.eval(frame.colors, frame.T, frame.depth)
        return [*frame.colors, frame.T]

    return run


def adjoints() -> list:
    δ = [mi.Float(np.random.default_rng(c).normal(size=WIDTH * HEIGHT)) for c in range(3)]
    dr.make_opaque(δ)
    return δ


def backward(splats: Splats, δT=None, **options) -> Callable[[], Any]:
    camera, δ = DeviceCamera.upload(CAMERA), adjoints()
    chosen = RasterOptions(**{"sh_degree": splats.sh_degree, **options})

    def run():
        params = attached(splats)
        frame = rasterize(params, camera, chosen)
        outputs, adjoint = (frame.colors, δ) if δT is None else ([*frame.colors, frame.T], [*δ, δT])
        for output, value in zip(outputs, adjoint, strict=True):
            dr.set_grad(output, value)
        dr.enqueue(dr.ADMode.Backward, outputs)
        dr.traverse(dr.ADMode.Backward)
        gradients = [dr.grad(value) for value in params.values() if dr.grad_enabled(value)]
        dr.eval(gradients)
        return gradients

    return run


def stripped_forward(splats: Splats) -> Callable[[], Any]:
    params, camera = upload(splats), DeviceCamera.upload(CAMERA)

    def run():
        colors, T = plain_renderer.render(params, camera)
        dr.eval(colors, T)
        return [*colors, T]

    return run


def stripped_backward(splats: Splats) -> Callable[[], Any]:
    camera, δ = DeviceCamera.upload(CAMERA), [dr.detach(δ, preserve_type=False) for δ in adjoints()]

    def run():
        params = attached(splats)
        plain_renderer.backward(params, camera, δ)
        gradients = [dr.grad(value) for value in params.values()]
        dr.eval(gradients)
        return gradients

    return run


# --- a model without DoG ---


@pytest.mark.parametrize(("engine", "stripped"), [(forward, stripped_forward), (backward, stripped_backward)])
def test_a_plain_model_costs_what_it_costs_in_a_renderer_without_any_option(engine, stripped):
    """The same launches, kernels of the same instructions, the same bits."""
    ours, lean = engine(model()), stripped(model())
    launched, expected = launches(ours), launches(lean)
    assert [(k.kind, k.size, k.operations) for k in launched] == [(k.kind, k.size, k.operations) for k in expected]
    for a, b in zip(launched, expected, strict=True):
        assert a.instructions == b.instructions
    # half as many pixels in a lane of CUDA, and one primitive per iteration
    assert sum(k.operations for k in launched) > (3000 if array_types().is_llvm else 1500)
    for a, b in zip(ours(), lean(), strict=True):
        np.testing.assert_array_equal(a.numpy(), b.numpy())


def test_a_plain_model_never_looks_at_the_modes_of_dog():
    plain = kernels(backward(model(), negative_transmittance=True))
    assert kernels(backward(model(), negative_transmittance=False)) == plain
    dog = [kernels(backward(model(dog_share=0.5), negative_transmittance=mode)) for mode in (True, False)]
    assert dog[0] != dog[1]


def test_dog_arrays_without_a_row_cost_nothing():
    splats = model(dog_share=0.5)
    without = Splats(**{**vars(splats.plain()), "dog_index": np.zeros(0, np.uint32)})
    assert kernels(forward(without)) == kernels(forward(splats.plain()))
    scene, plain = scene_of(splats, CAMERA), scene_of(splats.plain(), CAMERA)
    params = mi.traverse(scene)
    params["splats.dog_index"] = dr.zeros(mi.UInt32, 0)
    params["splats.dog_logit_opacities"] = mi.TensorXf(np.zeros(0, np.float32))
    params["splats.dog_log_scales"] = mi.TensorXf(np.zeros((0, 3), np.float32))
    params.update()
    assert kernels(lambda: mi.render(scene)) == kernels(lambda: mi.render(plain))


# --- a mixture ---

llvm_only = pytest.mark.skipif(not (mi.variant() or "").startswith("llvm"), reason="reads LLVM code; use llvm_ad_rgb")


@llvm_only
@pytest.mark.parametrize("run", [forward, backward])
def test_the_second_kernel_of_a_mixture_is_in_branches_that_packets_jump_over(run):
    plain, mixed = loop(launches(run(model()))), loop(launches(run(model(dog_share=0.5))))
    inside = branches(mixed.code)
    assert not branches(plain.code) and len(inside) % Blocks.of_backend().unroll == 0 and inside
    shift = "shl"  # an exponential ends in one; the others make addresses
    skipped = sum((instructions(code) for code in inside), Counter())
    exponentials = 3 * Blocks.of_backend().unroll
    assert plain.instructions[shift] >= exponentials
    assert mixed.instructions[shift] - skipped[shift] == plain.instructions[shift]
    assert skipped[shift] >= exponentials


def lanes_with_a_second_kernel(splats: Splats) -> tuple[int, int]:
    """Pseudo-Gaussians that lanes evaluate, counted as they do, and DoG primitives that are on the lists of lanes."""
    view = prepare(upload(splats), DeviceCamera.upload(CAMERA), RasterOptions(splats.sh_degree))
    assert isinstance(view, PreparedView)
    evaluated = dr.zeros(array_types().UInt, 1)
    pseudo_row = Walk.pseudo_row

    def counted(self, row):
        dr.scatter_add(evaluated, type(row)(1), type(row)(0))
        return pseudo_row(self, row)

    with pytest.MonkeyPatch.context() as patch, dr.scoped_set_flag(dr.JitFlag.KernelFreezing, False):
        patch.setattr(Walk, "pseudo_row", counted)
        dr.eval(composite(view))
    is_dog = np.isin(view.lists.splat_from_isect.numpy(), splats.dog_index)
    return int(evaluated.numpy()[0]), int(lanes_of_isects(view.lists, view.grid)[is_dog].sum())


def test_only_lanes_that_meet_a_dog_primitive_evaluate_a_second_kernel():
    splats = model(dog_share=0.2)
    splats.logit_opacities[:] = -4  # so that no walk ends early
    evaluated, met = lanes_with_a_second_kernel(splats)
    assert evaluated == met > 0
    splats.means[splats.dog_index, 2] = -1  # behind the camera
    assert lanes_with_a_second_kernel(splats) == (0, 0)


def test_dog_primitives_in_a_corner_leave_every_other_tile_as_it_was():
    splats = model()
    pixel, depth = np.array([7, 7]), 2.0
    seen_there = np.append((pixel - (CAMERA.cx, CAMERA.cy)) / (CAMERA.fx, CAMERA.fy) * depth, [depth, 1])
    one = rounded(make_splats((CAMERA.c2w @ seen_there)[:3], 0.03, 0.9, dog=[0]))
    mixed = Splats(**{name: np.concatenate([getattr(one, name), getattr(splats, name)]) for name in vars(splats)})
    images = [np.stack([p.numpy().reshape(HEIGHT, WIDTH) for p in forward(s)()]) for s in (mixed, mixed.plain())]
    changed = (images[0] != images[1]).any(0)
    assert changed[:16, :16].any() and not changed[16:].any() and not changed[:, 16:].any()


def test_a_mixture_takes_three_kernels_more_than_a_plain_model():
    """One of its own for what the pseudo-Gaussians share with their primaries, one for them, one for their table."""
    plain, mixed = kernels(forward(model())), kernels(forward(model(dog_share=0.5)))
    assert len(plain) < len(mixed) <= len(plain) + 3


# --- view-dependent colour ---


@pytest.mark.parametrize("run", [forward, backward])
def test_every_sh_degree_costs_more_per_primitive_and_nothing_else(run):
    degrees = [launches(run(model(degree))) for degree in range(4)]
    per_primitive = [sum(k.operations for k in launched if k.size == N) for launched in degrees]
    assert per_primitive == sorted(set(per_primitive))
    others = [[(k.size, k.operations) for k in launched if k.size != N and k.kind == "JIT"] for launched in degrees]
    assert all(other == others[0] for other in others)


def test_degrees_that_are_not_active_are_not_read():
    for degree in range(3):
        stored, least = (stages(forward(model(k), sh_degree=degree))["primitives"] for k in (3, degree))
        assert stored <= 1.01 * least  # rows of another length are read in other packets


# --- primitives with SH degrees of their own ---

IN_GROUPS = {1: 40, 2: 30, 3: 20}  # primitives of each degree, the others have degree 0


def mixture() -> Splats:
    """Its groups are of different sizes, so that kernels can be told apart."""
    degrees = np.repeat(list(IN_GROUPS), list(IN_GROUPS.values()))
    return model(3).with_sh_degrees(np.random.default_rng(0).permutation(np.append(degrees, [0] * (N - len(degrees)))))


def test_a_mixture_of_degrees_pays_for_each_group_in_lanes_of_its_own():
    """Beside what degree 0 takes: a kernel for each group, a memset, and one load of its sums for each primitive."""
    bare, found = launches(forward(model(0))), launches(forward(mixture()))
    more = Counter(k.kind for k in found if k.kind != "JIT") - Counter(k.kind for k in bare if k.kind != "JIT")
    assert more == Counter(["Memset"] if array_types().is_llvm else [])  # the history of CUDA has no memsets
    own = [k for k in found if k.kind == "JIT" and k.size in IN_GROUPS.values()]
    assert [k.size for k in own] == list(IN_GROUPS.values())
    others = [k for k in found if k.kind == "JIT" and k not in own]
    assert [k.size for k in others] == [k.size for k in bare if k.kind == "JIT"]
    more = [k.operations - b.operations for k, b in zip(others, [k for k in bare if k.kind == "JIT"], strict=True)]
    assert sum(more) == max(more) <= 10
    costs = [k.operations for k in own]
    assert costs == sorted(set(costs)) and costs[-1] < 400  # a projection with degree 3 takes 918


@llvm_only
def test_the_bands_of_a_group_are_all_that_its_lanes_read():
    found = {k.size: k.instructions for k in launches(forward(mixture())) if k.kind == "JIT"}
    for degree, size in IN_GROUPS.items():
        single, of_four = (sum(count for name, count in found[size].items() if part in name)
                           for part in ("masked.gather", "gather_4x"))
        assert (single, of_four) == (3, {1: 3, 2: 6, 3: 12}[degree])  # its centre; 9, 24 and 45 floats by four


def test_a_mixture_rendered_with_its_constant_colour_is_a_model_of_degree_0():
    bare, found = launches(forward(model(0))), launches(forward(mixture(), sh_degree=0))
    assert [(k.kind, k.size, k.instructions) for k in found] == [(k.kind, k.size, k.instructions) for k in bare]


def test_a_lower_degree_leaves_the_bands_above_out_of_every_group():
    costs = [{k.size: k.operations for k in launches(forward(mixture(), sh_degree=degree)) if k.kind == "JIT"}
             for degree in (1, 2, 3)]
    assert costs[0][20] < costs[1][20] < costs[2][20] and costs[0][30] < costs[1][30] == costs[2][30]
    assert costs[0][40] == costs[1][40] == costs[2][40]


def test_the_derivative_of_a_mixture_takes_small_kernels_more_than_that_of_degree_0():
    """Adjoints of colours for the groups, less the rows that later groups store, the groups, and sums for the centres,
    which both parts move."""
    bare, found = kernels(backward(model(0))), kernels(backward(mixture()))
    of_groups = [(size, k) for size, k in found if size in IN_GROUPS.values()]
    assert len(of_groups) == 2 * len(IN_GROUPS)  # forward and backward
    more = Counter(size for size, _ in found) - Counter(size for size, _ in bare)
    assert more == Counter({**dict.fromkeys(IN_GROUPS.values(), 2), N: 2, 3 * N: 1, 4 * N: len(IN_GROUPS) - 1})
    cost = [sum(k for size, k in launched if size in (N, 3 * N)) for launched in (bare, found)]
    assert cost[1] < 1.1 * cost[0]


@pytest.mark.parametrize("run", [forward, backward])
def test_a_uniform_model_runs_no_code_of_groups(run, monkeypatch):
    bare = launches(run(model(3)))

    def never(*_):
        raise AssertionError("called")

    monkeypatch.setattr("mi_dogsplat.engine.project.evaluate_groups", never)
    monkeypatch.setattr("mi_dogsplat.engine.project.has_groups", lambda params: False)
    assert [(k.kind, k.size, k.instructions) for k in launches(run(model(3)))] == [
        (k.kind, k.size, k.instructions) for k in bare
    ]


# --- choices of a render ---


@pytest.mark.parametrize(
    ("choice", "grows"),
    [
        ({}, ""),
        ({"negative_transmittance": False}, ""),
        ({"aovs": "alpha"}, "image"),
        ({"aovs": "depth"}, "primitives compositor image"),
        ({"aovs": "normal"}, "primitives compositor image"),
        ({"antialiased": True}, "primitives"),
        ({"srgb_primitives": True}, "image"),
        ({"film": {"pixel_format": "rgba"}}, "image"),
        ({"extra": {"sky": {"type": "constant"}}}, "image"),
        ({"extra": {"nobody": dog_dict(Splats.empty(0))}}, ""),
    ],
    ids=str,
)
def test_what_a_scene_does_not_ask_for_is_in_no_kernel(choice, grows):
    def cost(**options):
        scene = scene_of(model(), CAMERA, **{"srgb_primitives": False, **options})
        return kernels(lambda: mi.render(scene)), stages(lambda: mi.render(scene))

    (bare, least), (kernels_with_it, with_it) = cost(), cost(**choice)
    assert len(bare) == len(kernels_with_it)
    assert {stage for stage in least if with_it[stage] > least[stage]} == set(grows.split())
    assert all(with_it[stage] >= least[stage] for stage in least)
    assert grows or bare == kernels_with_it


@pytest.mark.parametrize("names", ["median_depth", "index", "count", "dog_share", "median_depth,index,count,dog_share"])
def test_aovs_that_need_a_walk_take_one_kernel_more_and_leave_the_others_as_they_are(names):
    """And one that stores depths, for the median depth: nothing else reads them from memory."""
    splats = model(dog_share=0.5)
    plain, scene = scene_of(splats, CAMERA), scene_of(splats, CAMERA, aovs=names)
    bare, with_it = (Counter(kernels(lambda s=s: mi.render(s))) for s in (plain, scene))
    more, lost = with_it - bare, bare - with_it
    lanes = Grid(WIDTH, HEIGHT, Blocks.of_backend()).n_tiles * Blocks.of_backend().lanes_per_tile
    expected = Counter([lanes, *([N] if "median_depth" in names else []), *(size for size, _ in lost.elements())])
    assert Counter(size for size, _ in more.elements()) == expected
    assert {size for size, _ in lost} <= {WIDTH * HEIGHT}  # where channels are put into the film


def test_an_image_without_aovs_runs_no_code_of_theirs(monkeypatch):
    splats = model(dog_share=0.5)
    scene = scene_of(splats, CAMERA)
    bare = kernels(lambda: mi.render(scene))
    monkeypatch.setattr("mi_dogsplat.engine.aovs.channels", lambda *_: [])
    assert kernels(lambda: mi.render(scene)) == bare


def test_each_aov_of_the_walk_is_paid_alone():
    splats = model(dog_share=0.5)

    def cost(*names: str) -> int:
        scene = scene_of(splats, CAMERA, aovs=",".join(names))
        return stages(lambda: mi.render(scene))["compositor"]

    alone = {name: cost(name) for name in WALKED}
    assert all(cost(*WALKED) > alone[name] > cost() for name in WALKED)


def test_a_plain_model_makes_no_walk_for_the_share_of_dog():
    bare, asked = (scene_of(model(), CAMERA, aovs=names) for names in ("", "dog_share"))
    assert len(kernels(lambda: mi.render(asked))) == len(kernels(lambda: mi.render(bare)))


def test_derivatives_make_no_walk_for_aovs_that_have_none():
    def cost(*names: str) -> int:
        scene: Any = scene_of(model(dog_share=0.5), CAMERA, aovs=",".join(names))
        params: Any = mi.traverse(scene)
        shape = HEIGHT, WIDTH, 3 + len(names)
        adjoint = mi.TensorXf(dr.opaque(mi.Float, 1, HEIGHT * WIDTH * shape[2]), shape)

        def run():
            dr.enable_grad(params["splats.means"])
            params.update()
            scene.integrator().render_backward(scene, params, adjoint, sensor=0)

        return stages(run)["compositor"]

    assert cost("alpha", *WALKED) == cost("alpha") > 0


def test_the_adjoint_of_transmittance_is_paid_only_where_something_lies_behind():
    least = stages(backward(model()))
    behind = stages(backward(model(), δT=dr.opaque(mi.Float, 1, WIDTH * HEIGHT)))
    assert {stage for stage in least if behind[stage] > least[stage]} == {"compositor"}


# --- a training step ---


@pytest.fixture(scope="module")
def datasets(data, alpha_data):
    return [load_dataset(folder) for folder in (data, alpha_data)]


def trainer_of(dataset, **settings) -> Trainer:
    """One that is between two rows of its history."""
    quiet: dict[str, Any] = {"steps": 1000, "log_every": 900, "test_every": 900, "variant": mi.variant()}
    config = TrainConfig(str(dataset.path), **{"preset": "3dgs", "sh_degree": 0, **quiet, **settings})
    trainer = Trainer(config, dataset)
    assert not any(trainer.step() for _ in range(3))
    return trainer


def step(trainer: Trainer) -> list[tuple[int, int]]:
    """Kernels of a training step, but for those that have a lane per isect, whose number changes."""
    forget_recordings()
    n, blocks = trainer.optimizer.n, Blocks.of_backend()
    pixels = tiny_data.WIDTH * tiny_data.HEIGHT
    lanes = Grid(tiny_data.WIDTH, tiny_data.HEIGHT, blocks).n_tiles * blocks.lanes_per_tile
    known = {1, n, 3 * n, 4 * n, 48 * n, pixels, lanes}
    return [(size, operations) for size, operations in kernels(trainer.step) if size in known]


def test_a_black_background_costs_what_no_background_costs(datasets, monkeypatch):
    black, white = step(trainer_of(datasets[0], background="black")), step(trainer_of(datasets[0], background="white"))
    assert len(black) == len(white) and sum(k for _, k in black) < sum(k for _, k in white)

    def without(self, params, view, probe=None):
        frame = rasterize(params, self.photographs.cameras[view], self.options, probe)
        return frame.colors, frame

    monkeypatch.setattr(Trainer, "render", without)
    assert step(trainer_of(datasets[0], background="black")) == black


@pytest.mark.parametrize("background", ["black", "white"])
def test_alpha_masks_cost_nothing_per_step(datasets, background):
    assert datasets[1].has_alpha and not datasets[0].has_alpha
    assert step(trainer_of(datasets[0], background=background)) == step(trainer_of(datasets[1], background=background))


def test_pruning_and_dog_cost_nothing_before_they_start(datasets):
    assert step(trainer_of(datasets[0], preset="ours")) == step(trainer_of(datasets[0], preset="3dgs"))


def test_sh_degree_0_trains_without_the_other_coefficients(datasets):
    least, most = trainer_of(datasets[0]), trainer_of(datasets[0], sh_degree=3)
    assert sum(dr.width(values) for values in least.optimizer.adam.values()) == 14 * least.optimizer.n
    before = step(least)
    assert step(most) == before  # as long as degree 0 is all that is rendered
    most.step_count = 999  # the last one, where all degrees are
    assert most.active_sh_degree == 3
    assert sum(k for _, k in step(most)) > sum(k for _, k in before)


def test_a_mixed_model_trains_without_the_coefficients_that_its_primitives_do_not_have(datasets):
    least, most, mixed = trainer_of(datasets[0]), *(trainer_of(datasets[0], sh_degree=3) for _ in range(2))
    n = mixed.optimizer.n
    mixed.optimizer.set_sh_degrees(np.arange(n) % 2)
    assert sum(dr.width(values) for values in mixed.optimizer.adam.values()) == 14 * n + 12 * (n // 2)
    assert step(mixed) == step(least)  # as long as degree 0 is all that is rendered
    for trainer in (mixed, most):
        trainer.step_count = 999
    assert mixed.active_sh_degree == 1
    cost = {name: sum(size * k for size, k in kernels(trainer.step))
            for name, trainer in (("least", least), ("mixed", mixed), ("most", most))}
    assert cost["least"] < cost["mixed"] < cost["most"]


def test_gradients_of_the_centres_are_taken_only_while_there_is_densification(datasets):
    during, after = trainer_of(datasets[0]), trainer_of(datasets[0])
    change_densification(after, stop=0)
    assert sum(k for _, k in step(after)) < sum(k for _, k in step(during))


def test_masks_appearance_and_random_backgrounds_cost_nothing_when_they_are_off(datasets, monkeypatch):
    off = step(trainer_of(datasets[1]))

    def bare(self, planes, view, step, upcoming=()):
        l1, _, loss, gradient = self.loss.value_and_gradient(planes, self._kept[view])
        return l1, loss, gradient

    with monkeypatch.context() as patched:
        patched.setattr(Photographs, "compare", bare)
        patched.setattr(Photographs, "choose_background", lambda self, rng: None)
        assert step(trainer_of(datasets[1])) == off
    for on in ({"appearance": True}, {"background": "random"}):
        assert sum(k for _, k in step(trainer_of(datasets[1], **on))) > sum(k for _, k in off)


def test_options_about_images_compile_nothing_from_step_to_step(datasets, tmp_path):
    for view in datasets[1].train:
        write_png(tmp_path / f"{view.name}.png", np.eye(tiny_data.HEIGHT, tiny_data.WIDTH))
    options: dict[str, Any] = {"appearance": True, "background": "random", "masks": str(tmp_path), "near_zone": 0.1}
    trainer = trainer_of(datasets[1], **options)
    change_densification(trainer, stop=0)
    known = [compiled(trainer.step) for _ in range(10)]
    assert known[-1] <= set().union(*known[:5]) and known[-2] <= set().union(*known[:5])
