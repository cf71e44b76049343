"""Every frozen function of the package, with one setting after another: no call replays what another one recorded."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from frozen_functions import forget, frozen_functions
from mi_dogsplat.engine.arrays import detached
from mi_dogsplat.engine.bands import PreparedView, WalkableView
from mi_dogsplat.engine.device_camera import DeviceCamera, Nudge
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.parameters import device_array, upload
from mi_dogsplat.engine.projected import replayed
from mi_dogsplat.engine.rows import NO_ROW
from mi_dogsplat.engine.view import prepare, prepare_both
from mi_dogsplat.engine.walks.adjoints import composite_backward
from mi_dogsplat.engine.walks.aovs import composite_aovs, walked
from mi_dogsplat.engine.walks.composite import composite, composite_over
from mi_dogsplat.engine.walks.fisher import composite_fisher, patch_blocks
from mi_dogsplat.engine.walks.pixels import Planes
from mi_dogsplat.engine.walks.score import Sums, composite_score
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.engine.walks.squared_weights import composite_squared_weights
from mi_dogsplat.engine.walks.weights import composite_weights
from mi_dogsplat.scores.score import CUT_KINDS, ScoreRule
from mi_dogsplat.scores.training_views import TrainingViews
from mi_dogsplat.training.images.image_formation import ImageSize, formed, formed_gradients
from mi_dogsplat.training.images.loss import PhotometricLoss
from mi_dogsplat.training.optimizer.adam import Entry
from mi_dogsplat.training.optimizer.adam_step import replayed_step
from mi_dogsplat.training.optimizer.joint_steps import JointArray, Numbers, joint_steps
from mi_dogsplat.training.optimizer.triangles import n_pairs
from mi_dogsplat.training.optimizer.triangles import upload as upload_triangles
from read_together import read
from splat_scenes import make_camera, options, random_splats, rounded

pytestmark = pytest.mark.usefixtures("small_blocks")
CAMERA = make_camera(16, 12, f=14.0)
NUMBERS = (0.3, -0.2, 0.1, -0.4, -0.2)  # of a camera: gains, vignetting
OPTIONS = ({}, {"patch": 1}, {"patch": 2}, {"negative_transmittance": False}, {"cutoffs": SMOOTH},
           {"patch": 1, "negative_transmittance": False}, {"cut_share": 0.5}, {"dog_share": 0},
           {"cut_share": 0.5, "dog_share": 0}, {"second_cut_share": 0.7}, {"cut_share": 0.5, "second_cut_share": 0.5},
           {"dog_share": 0, "patch": 1})
# Each kind of rows alone, two together, and all: what a call is told apart by has a field for each, whatever the others
SLOPED = (*OPTIONS, {"slope_share": 0.5}, {"curvature_share": 0.5}, {"slope_share": 0.5, "cut_share": 0.5},
          {"curvature_share": 0.5, "slope_share": 0.5},
          {"curvature_share": 0.5, "slope_share": 0.5, "cut_share": 0.5, "second_cut_share": 0.5})
RULES = ({}, {"kind": "released"}, {"kind": "leave-one-out"}, {"spectral_weight": 0}, {"spatial_weight": 0},
         {"kind": "leave-one-out", "spectral_weight": 0}, {"gamma_f": 2, "probes": 0}, {"probes": 2}, {"probes": 3},
         {"kind": "leave-one-out", "gamma_f": 2, "probes": 0}, {"spatial_weight": 0, "probes": 2},
         {"kind": "leave-one-out", "probes": 2}, *({"kind": kind, "spectral_weight": 0} for kind in CUT_KINDS))


@cache
def model(dog_share: float, slope_share: float = 0, cut_share: float = 0, second_cut_share: float = 0,
          curvature_share: float = 0):  # fmt: skip
    return rounded(random_splats(10, 3, 1, dog_share, slope_share, cut_share, second_cut_share, curvature_share))


def view_of(
    dog_share=0.5, blocks=None, slope_share=0.0, cut_share=0.0, second_cut_share=0.0, curvature_share=0.0, **chosen
) -> WalkableView:
    splats = model(dog_share, slope_share, cut_share, second_cut_share, curvature_share)
    return prepare(upload(splats), DeviceCamera.upload(CAMERA), options(splats, **chosen), blocks)


def listed(n=10, width=16, height=12, dog_share=0.5) -> np.ndarray:
    splats = rounded(random_splats(n, 3, 1, dog_share))
    camera = DeviceCamera.upload(make_camera(width, height, f=14.0))
    view = prepare(upload(splats), camera, options(splats))
    assert isinstance(view, PreparedView)
    return np.concatenate([part.numpy() for part in (view.lists.splat_from_isect, view.lists.begin, view.lists.end)])


def planes(order: str) -> list:
    """A random plane for each letter, the same object for the same letter."""
    of_letter = {}
    for letter in order:
        noise = np.random.default_rng(ord(letter)).normal(size=CAMERA.width * CAMERA.height)
        of_letter.setdefault(letter, detached(device_array(noise)))
    return [of_letter[letter] for letter in order]


def rows(columns: list) -> np.ndarray:
    return np.stack([column.numpy().astype(np.float64) for column in columns])


def blended(**chosen) -> np.ndarray:
    found = composite(view_of(**chosen))
    return rows([*found.features, found.T])


def adjoints(order="abcd", **chosen) -> np.ndarray:
    view, (*δ, δT) = view_of(**chosen), planes(order)
    δsplats, δpseudo = composite_backward(view, composite(view), Planes(δ, δT))
    return np.concatenate([rows(part).ravel() for part in (δsplats, δpseudo) if part])


def summed(order="abc", removal=True, probes=0, shared=False, **chosen) -> np.ndarray:
    sums = Sums(removal=removal, probes=probes)
    view, count = view_of(blocks=sums.blocks, **chosen), probes * sums.channels
    image, noise = planes(order), planes("defghi"[:count])
    share = detached(device_array(np.linspace(0, 1, 10))) if shared else None
    return rows(composite_score(view, sums, image, noise, share))


def score(kind="spatio-spectral", **rule) -> np.ndarray:
    splats = model(0.5, 0, *((0.5, 0.5) if kind in CUT_KINDS else (0, 0)))
    views = TrainingViews([DeviceCamera.upload(CAMERA)], options(splats), 0.3)
    return ScoreRule(kind, **rule)(upload(splats), views, 0)


def found(names=("median_depth", "index", "count", "dog_share"), dog_share=0.5, **chosen) -> np.ndarray:
    view = view_of(dog_share, **chosen)
    names = walked(names, dog_share > 0)
    depths = detached(device_array(model(dog_share).means[:, 2])) if "median_depth" in names else None
    return rows(composite_aovs(view, names, depths))


def products(order=None, background=0.3, **chosen) -> np.ndarray:
    shares = (("dog_share", 0.5), ("slope_share", 0), ("cut_share", 0), ("second_cut_share", 0), ("curvature_share", 0))
    splats = model(*(chosen.pop(*share) for share in shares))
    pictured, patches = prepare_both(upload(splats), DeviceCamera.upload(CAMERA), options(splats, **chosen),
                                     patch_blocks())
    return rows(composite_fisher(patches, composite_over(pictured, background) if order is None else planes(order)))


def weighted(order="a", **chosen) -> np.ndarray:
    columns, largest = composite_weights(view_of(**chosen), planes(order)[0])
    return rows([*columns, largest])


def squared(**chosen) -> np.ndarray:
    return rows([composite_squared_weights(view_of(**chosen))])


def picture(letters: str, width: int, height: int) -> np.ndarray:
    return rows(planes(letters))[:, : width * height].T.reshape(height, width, 3)


def target(width=9, height=5, letters="xyz") -> np.ndarray:
    """A photograph as the loss compares with it."""
    prepared = PhotometricLoss().target(picture(letters, width, height))
    return np.concatenate([rows(part).ravel() for part in (prepared.rows, prepared.mean, prepared.mean_sq)])


def pulled(width=9, height=5, dssim_weight=0.2, order="abc", letters="xyz") -> np.ndarray:
    """The loss and its gradient."""
    loss = PhotometricLoss(dssim_weight)
    image = [detached(device_array(plane)) for plane in rows(planes(order))[:, : width * height]]
    *values, gradient = loss.value_and_gradient(image, loss.target(picture(letters, width, height)))
    return np.concatenate([rows(values).ravel(), rows(gradient).ravel()])


def cut_planes(order: str, n: int) -> list:
    """The first n pixels of ``planes``, the same object for the same letter too."""
    of_letter = dict(zip(order, (detached(device_array(plane[:n])) for plane in rows(planes(order))), strict=True))
    return [of_letter[letter] for letter in order]


def taken(width=9, height=5, order="abc") -> np.ndarray:
    """As a camera takes it."""
    frame, numbers = ImageSize.of(width, height), detached(device_array(np.array(NUMBERS)))
    return rows(formed(cut_planes(order, width * height), numbers, frame))


def taken_back(width=9, height=5, order="abcdef") -> np.ndarray:
    frame, numbers = ImageSize.of(width, height), detached(device_array(np.array(NUMBERS)))
    shown, adjoint = (cut_planes(letters, width * height) for letters in (order[:3], order[3:]))
    by_planes, sums = formed_gradients(shown, numbers, frame, adjoint)
    return np.concatenate([rows(by_planes).ravel(), sums.numpy()])


def cast(n=10, nudged=False, seed=3, sh_degree=1, antialiased=False, **shares) -> tuple[dict, list, list]:
    """Parameters and the camera's nudge, both attached, and what a projection makes of them."""
    params = upload(rounded(random_splats(n, seed, 1, **({"dog_share": 0.5} | shares))))
    dr.enable_grad([value for value in params.values() if dr.is_float_v(value)])
    nudge = Nudge.of(n) if nudged else None
    camera = replace(DeviceCamera.upload(CAMERA), nudge=nudge)
    p = replayed(params, camera, sh_degree=sh_degree, antialiased=antialiased)
    kernels = [p.kernels, *([p.pseudo] if p.pseudo else [])]
    columns = [p.x, p.y, p.depth, *(v for k in kernels for v in (k.ux, k.uy, k.vy, k.lo)), *p.colors, *p.varying]
    return params | ({f"nudge {k}": v for k, v in enumerate(nudge.values)} if nudge else {}), columns, kernels


def projection_of(**chosen) -> np.ndarray:
    _, columns, kernels = cast(**chosen)
    spread = [value for k in kernels for value in (k.variance_x, k.variance_y)]
    return np.concatenate(read([*columns, *spread]))


def pulled_back(order="ab", **chosen) -> np.ndarray:
    """Gradients of the parameters; columns in turn have adjoints that are the same object for the same letter."""
    params, columns, _ = cast(**chosen)
    adjoints = {letter: {} for letter in order}
    for k, column in enumerate(columns):
        of_size = adjoints[order[k % len(order)]]
        n = dr.width(column)
        if n not in of_size:
            of_size[n] = mi.Float(np.random.default_rng(ord(order[k % len(order)])).normal(size=n))
        dr.set_grad(column, of_size[n])
    dr.enqueue(dr.ADMode.Backward, columns)
    dr.traverse(dr.ADMode.Backward)
    return np.concatenate(read(dr.grad(value) for value in params.values() if dr.is_float_v(value)))


def adam_moved(sizes=(6, 4), steps=1, unused=(), wanted=(), order="abc", **numbers) -> np.ndarray:
    """Values, moments and what was asked for after some steps; the gradients of two arrays may be one object."""
    of_names = list(zip("xyz"[: len(sizes)], order[: len(sizes)], sizes, strict=True))
    values = {name: mi.Float(np.linspace(0.1, 0.9, size) + ord(name)) for name, _, size in of_names}
    rule: dict[str, Any] = {"beta_1": 0.9, "beta_2": 0.999, "epsilon": 1e-15} | numbers
    adam = mi.ad.Adam(0.1, values, **rule)
    adam.set_learning_rate({name: 0.1 / (1 + k) for k, name in enumerate(values)})
    found = []
    for step in range(steps):
        gradients = {(letter, size): mi.Float(np.cos(np.arange(size) + ord(letter) + step))
                     for _, letter, size in of_names}
        for name, letter, size in of_names:
            dr.set_grad(adam[name], gradients[letter, size])
        found = [of for pair in replayed_step(adam, unused, wanted).values() for of in pair]
    entries = [Entry.of(adam, name) for name in adam]
    return np.concatenate([x.numpy() for e in entries for x in (e.value, e.m, e.v)] + [x.numpy() for x in found])


STEP = {"prior": 0.2, "memory": 0.9, "damping": 0.2}


def stepped(n=6, sizes=(3, 1), rows=False, order="abcd", of_m=(0.2, 0.2), of_v=0.01, **numbers) -> np.ndarray:
    """A joint step of arrays with rows of those sizes; with ``rows``, only two primitives have one in the last."""
    arrays = []
    for j, size in enumerate(sizes):
        own = np.array([1, 3]) if rows and j == len(sizes) - 1 else np.arange(n)
        row = np.full(n, np.uint32(NO_ROW))
        row[own] = np.arange(len(own))
        row_of, of_row = (detached(mi.UInt32(index.astype(np.uint32))) if rows else None for index in (row, own))
        value, gradient, m, v = cut_planes(order, size * len(own))
        arrays.append(JointArray(size, row_of, of_row, value, gradient, m, dr.abs(v) + 0.1))
    d = sum(sizes)
    S = np.array([np.full(n, 0.2 if i == j else 0.01) for i in range(d) for j in range(i + 1)])
    assert len(S) == n_pairs(d)
    rates = np.linspace(0.1, 0.2, len(sizes))
    of_arrays = [[rate, of_m[j % len(of_m)], of_v] for j, rate in enumerate(rates)]
    opaque = [[detached(dr.opaque(mi.Float, number)) for number in row] for row in of_arrays]
    values, found = joint_steps(arrays, opaque, upload_triangles(S), Numbers(**{"epsilon": 1e-8} | STEP | numbers))
    return np.concatenate([part.numpy().astype(np.float64) for part in (*values, *found)])


SIZES = ({}, *({"width": w, "height": h} for w, h in ((5, 9), (15, 3), (1, 1))))
# more and fewer primitives than tiles, and once both
LISTS = ({}, {"n": 1}, {"n": 7}, {"n": 41}, {"n": 300}, {"width": 90, "height": 70}, {"n": 300, "width": 90},
         {"dog_share": 0, "n": 40}, {"dog_share": 0, "n": 299})
CAST = ({}, {"n": 7}, {"n": 11}, {"dog_share": 0}, {"dog_share": 1}, {"antialiased": True}, {"sh_degree": 0},
        {"slope_share": 0.5}, {"curvature_share": 0.5}, {"cut_share": 0.5, "second_cut_share": 0.5})
CASES: dict[str, tuple[Callable[..., np.ndarray], tuple[dict, ...]]] = {
    "_composite": (blended, SLOPED),
    "_composite_backward": (adjoints, (*SLOPED, *({"order": o} for o in ("aaaa", "abab", "abba", "abaa", "abbb")))),
    "_composite_score": (summed, (*SLOPED, {"removal": False}, {"removal": False, "probes": 2}, {"probes": 1},
                                  {"shared": True}, {"order": "aba"}, {"order": "abb"}, {"order": "aaa"})),
    "_composite_score by rules": (score, RULES),
    "_composite_aovs": (found, (*OPTIONS[:-1], *({"names": (name,)} for name in ("median_depth", "index", "count")),
                                {"names": ("index", "count")}, {"names": ("count", "dog_share")})),
    "_composite_fisher": (products, (*SLOPED, {"order": "aba"}, {"order": "abb"}, {"order": "aab"})),
    "_values": (projection_of, CAST),
    "_gradients": (pulled_back, (*CAST, {"order": "abc"}, {"order": "a"}, {"nudged": True}, {"nudged": True, "n": 12})),
    "_stepped": (adam_moved, ({}, {"sizes": (4, 6)}, *({"sizes": (4, 4), "order": o} for o in ("aab", "aba")),
                              {"sizes": (6, 4, 6)}, {"sizes": (6, 4, 6), "order": "aba"}, {"steps": 3},
                              {"unused": ("y",)}, {"wanted": ("x",)}, {"wanted": ("y",)}, {"wanted": ("y", "x")},
                              {"beta_1": 0.8}, {"beta_2": 0.99}, {"epsilon": 0.01})),
    "_counted": (listed, LISTS),
    "_written": (listed, LISTS),
    "_rows_and_moments": (target, (*SIZES, {"letters": "xxy"})),
    "_sums_and_gradient": (pulled, (*SIZES, {"dssim_weight": 0}, {"dssim_weight": 1}, {"order": "aaa"},
                                    {"letters": "abc"})),
    "_squared_weights": (squared, OPTIONS),
    "_composite_weights": (weighted, (*OPTIONS, {"order": "b"})),
    "formed": (taken, (*SIZES, {"order": "aba"}, {"order": "aab"})),
    "joint_steps": (stepped, ({}, {"n": 7}, {"sizes": (1, 3)}, {"sizes": (3, 1, 2)}, {"rows": True},
                              {"of_m": (0.2, 0.4)}, {"of_v": 0.02}, {"epsilon": 0.01},
                              {"rows": True, "sizes": (1, 3)}, {"order": "aacd"}, {"order": "abbd"}, {"order": "abcc"},
                              *({name: 0.9 * value, "rows": True} for name, value in STEP.items()))),
    "formed_gradients": (taken_back, (*SIZES, {"order": "aabcde"}, {"order": "abcdee"})),
}


@cache
def each_alone(name: str) -> list[np.ndarray]:
    """What each setting computes when nothing is recorded yet."""
    run, settings = CASES[name]
    found = []
    for setting in settings:
        forget()
        found.append(run(**setting))
    return found


def test_every_frozen_function_of_the_package_is_tried():
    assert {name.split()[0] for name in CASES} == set(frozen_functions())


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_call_computes_the_same_whichever_was_recorded_before_it(name):
    """All settings in turn and back again: of each two, either comes first once, when the other is not recorded yet."""
    run, settings = CASES[name]
    alone = each_alone(name)
    # bits, where they are the same in every run: with another patch they are nearly the same numbers
    rtol, atol = (0, 0) if lanes_add_in_turn(mi.variant()) else (1e-3, 1e-5)
    wrong = []
    for order in (range(len(settings)), reversed(range(len(settings)))):
        forget()
        before: list[dict] = []
        for k in order:
            try:
                np.testing.assert_allclose(run(**settings[k]), alone[k], rtol=rtol, atol=atol)
            except Exception as error:  # Dr.Jit raises what it likes where a recording does not fit
                wrong.append(f"{settings[k]} after {before}: {type(error).__name__}")
            before.append(settings[k])
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", CASES)
def test_settings_differ_in_what_they_compute(name):
    """Or it would not be seen when one recording is taken for another."""
    settings, results = CASES[name][1], each_alone(name)
    same = [(settings[i], settings[j]) for i, j in itertools.combinations(range(len(settings)), 2)
            if results[i].shape == results[j].shape and (results[i] == results[j]).all()]
    assert not same
