"""Stiff and extreme inputs: small scenes, each with one thing in it that breaks naive splatting code.

Every case stands among a dozen ordinary primitives, so that harm done to neighbours shows as well. What the right
answer is says the float64 twin (``reference/``): it drops what is not in front of the near plane or not finite, and
evaluates the formula for all the rest. Where float32 cannot, or nobody could say what is right, ``defined`` says in
words what happens instead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..scene.cameras import Camera
from ..scene.row_groups import CURVATURES, CUTS, SECOND_CUTS, SHIFTS, SLOPES
from ..scene.splats import Splats
from .case_models import (
    C0,
    CURVATURES_OF_ONE,
    NORMAL_OF_ONE,
    SCALES,
    SECOND_NORMAL_OF_ONE,
    SHIFTS_OF_ONE,
    SLOPES_OF_ONE,
    WIDTH,
    bystanders,
    camera,
    moved,
    own_views,
    primitives,
)

BELOW = "below 1/255 everywhere: not drawn, gradient zero"
OF_ONE = {  # an argument of ``primitives``: the rows that it makes, and an ordinary one
    "slopes": (SLOPES, SLOPES_OF_ONE),
    "curvatures": (CURVATURES, CURVATURES_OF_ONE),
    "normals": (CUTS, NORMAL_OF_ONE),
    "second_normals": (SECOND_CUTS, SECOND_NORMAL_OF_ONE),
    "shifts": (SHIFTS, SHIFTS_OF_ONE),
}


@dataclass(frozen=True)
class Case:
    """A scene, and what to expect of it."""

    group: str
    name: str
    splats: Splats
    camera: Camera
    extreme: np.ndarray  # rows of the primitives that make the case
    defined: str = ""  # what happens where the formula has no answer; empty: the float64 twin is right
    hidden: bool = False  # below 1/255: compare gradients with the cutoffs, which make them zero
    near_clip: float = 0.2
    background: tuple[float, float, float] = (0.1, 0.2, 0.3)


def cases(layers: int = 10_000) -> Iterator[Case]:
    """All cases, group by group; of primitives before each other there are so many ``layers``."""
    yield from _shapes()
    yield from _opacities_and_colors()
    yield from _depths(layers)
    yield from _quaternions()
    yield from _dog(layers)
    yield from _slopes()
    yield from _curvatures()
    yield from _cuts()
    yield from _shifts()
    yield from _not_finite()
    yield from _cameras()


def _case(group: str, name: str, extreme: Splats, defined: str = "", view: Camera | None = None, **settings) -> Case:
    """``extreme`` among the bystanders, its rows last; among such with rows of its kinds, if it has some."""
    kinds = [kind for kind, (group, _) in OF_ONE.items() if len(getattr(extreme, group.index))]
    neighbours = bystanders(**{kind: OF_ONE[kind][1] for kind in kinds})
    splats = neighbours.joined(extreme)
    rows = np.arange(neighbours.n_splats, splats.n_splats)
    return Case(group, name, splats, view or camera(), rows, defined, **settings)


def _extents() -> Iterator[tuple[str, str, tuple[float, float, float], Any]]:
    """Group, name, mean and scales of primitives that are long, flat, large or small."""
    usual = (0.1, 0.2, 4)
    for exponent in range(1, 7):
        ratio = 10.0**exponent
        for name, scales in {"needle": (1 / ratio, 1 / ratio, 1), "disc": (1 / ratio, 1, 1)}.items():
            yield "shape", f"{name}, axis ratio 1e{exponent}", usual, scales
    yield "shape", "needle, 40,000 px long", usual, (1e-3, 1e-3, 1e3)
    yield "shape", "needle along the optical axis", (0.02, 0.01, 4), (0.05, 0.05, 50)
    for exponent in (-12, -6, -3, 3, 6, 12):
        yield "size", f"scale 1e{exponent}", usual, 10.0**exponent
    yield "size", "scales 1e-12, 1 and 1e6 in one", usual, (1e-12, 1, 1e6)


def _shapes() -> Iterator[Case]:
    for group, name, mean, scales in _extents():
        yield _case(group, name, primitives(mean, scales))
    for exponent in (80, 100, -300):  # the exponential of 100 is no float32
        yield _case("size", f"scale e^{exponent}", primitives((0.1, 0.2, 4), log_scales=exponent))
    rng = np.random.default_rng(3)
    many = rng.uniform([-1.2, -1, 3], [1.2, 1, 5], (300, 3))
    specks = primitives(many, (1e-4, 2e-4, 3e-4), color=rng.uniform(0, 1, (300, 3)))
    yield _case("size", "300 of a thousandth of a pixel", specks)
    yield _case("size", "20 that fill the screen", primitives(many[:20], (20, 30, 40), 0.3))


def _opacities_and_colors() -> Iterator[Case]:
    for logit in (-np.inf, -1e4, -88, -17, 17, 88, 1e4, np.inf):
        yield _case("opacity", f"logit {logit:g}", primitives((0.1, 0.2, 3), logits=logit))
    for value in (1e4, 1e8, -1e8, 1e30):
        yield _case("colour", f"constant SH coefficient {value:g}", primitives((0.1, 0.2, 3), color=0.5 + C0 * value))


def _depths(n_layers: int) -> Iterator[Case]:
    yield _case("depth", "five coincident", primitives([(0.1, 0.2, 3)] * 5))
    plane = np.column_stack([*np.random.default_rng(5).uniform(-0.8, 0.8, (2, 40)), np.full(40, 3.0)])
    forty = replace(primitives(plane, (0.1, 0.2, 0.3), color=np.linspace(0, 1, 120).reshape(40, 3)), means=plane)
    ahead = replace(camera(), w2c=np.eye(4))  # or rounding would set their depths apart
    yield _case("depth", "forty of equal depth", forty, "drawn in the order of their rows", ahead)
    for name, z in {"on the camera": 0.0, "behind the camera": -2.0, "a bit nearer than the near plane": 0.1999,
                    "a bit farther": 0.2001}.items():  # fmt: skip
        yield _case("depth", name, primitives((0.0 if z == 0 else 0.02, 0.0, z)))
    yield _case("depth", "wide, its centre behind the camera", primitives((0.1, 0, -0.5), (2, 3, 4)))
    yield _case("depth", "wide, its centre just before the near plane", primitives((0.1, 0, 0.21), (2, 3, 4)))
    close = primitives((1e-7, 0, 1e-6), (1e-7, 2e-7, 3e-7))
    yield _case("depth", "no near plane, 1e-6 before the camera", close, near_clip=0.0)
    off_axis = primitives((2.0, 0, 1e-4))
    yield _case("depth", "no near plane, far off the axis", off_axis, BELOW, near_clip=0.0, hidden=True)
    yield _case("depth", "1e8 away", primitives((1e7, 0, 1e8), (1e7, 2e7, 3e7)))
    rng = np.random.default_rng(1)
    layers = np.column_stack([*rng.uniform(-0.3, 0.3, (2, n_layers)), np.linspace(2, 6, n_layers)])
    for opacity in (0.003, 0.0045, 0.05, 0.999):
        colors = rng.uniform(0, 1, (n_layers, 3))
        name = f"{n_layers:,} layers of opacity {opacity}"
        yield _case("depth", name, primitives(layers, opacity=opacity, color=colors))


def _quaternions() -> Iterator[Case]:
    direction = np.array([0.3, -0.2, 0.5, 0.8])
    for length in (0, 1e-30, 1e-12, 1e-3, 1e3, 1e12, 1e30):
        name = f"length {length:g}" + (": no rotation" if length == 0 else "")
        yield _case("quaternion", name, primitives((0.1, 0.2, 3), (0.1, 0.3, 0.6), quats=direction * length))


def _dog(n_layers: int) -> Iterator[Case]:
    def dog(name: str, f_a: float, F: float, count: int = 1, opacity: float = 0.7, defined: str = "", **more) -> Case:
        means = np.column_stack([np.full((count, 2), 0.1), np.linspace(2.5, 3.5, count)])
        return _case("DoG", name, primitives(means, SCALES, opacity, dog=True, f_a=f_a, F=F), defined, **more)

    # the subtraction G - G_p is exact, and its operands' rounding of 6e-8 is little beside 1/255
    yield dog("f_a and F at 1 - 0.01", 0.99, 0.99)
    for gap in (1e-4, 1e-6):
        yield dog(f"f_a and F at 1 - {gap:g}", 1 - gap, 1 - gap, defined=BELOW, hidden=True)
    for gap in (1e-2, 1e-4, 1e-6):
        yield dog(f"f_a at 1 - {gap:g}, F .5: a hollow centre", 1 - gap, 0.5)
    yield dog("f_a .5, F 1e-6: a prick", 0.5, 1e-6)
    yield dog("f_a .5, F 1e4: a veil", 0.5, 1e4)
    yield dog("f_a .5, F 1e8", 0.5, 1e8)
    yield dog("f_a 1e-30: no pseudo-Gaussian", 1e-30, 1.6)
    yield dog("f_a 0", 0, 1.6)
    yield dog("f_a 1", 1, 1.6)
    yield dog("20 negative lobes on each other", 0.9, 1.6, 20)
    yield dog("200 negative lobes on each other", 0.5, 1.3, 200)
    ends = "the walk ends before T would exceed 2^30"
    for count in (500, n_layers):
        yield dog(f"{count:,} negative lobes on each other", 0.9, 2.0, count, 0.9, ends)


def _along_own_axes(of_one: Callable[..., Case]) -> Iterator[Case]:
    """Of a group whose numbers are along the axes of the primitive, everything that these may be."""
    yield of_one("ordinary")
    for _, name, mean, scales in _extents():
        yield of_one(name, mean, scales)
    yield of_one("wide, its centre just before the near plane", (0.1, 0, 0.21), (2, 3, 4))
    yield of_one("wide, its centre far beside the image", (30, 5, 4), (20, 15, 10))
    yield of_one("opaque", logits=17)
    for f_a, F in ((0.5, 1.6), (0.5, 0.1), (0.9, 10), (0.999999, 0.5)):
        yield of_one(f"DoG, f_a {f_a:g}, F {F:g}", (0.1, 0.2, 3), dog=True, f_a=f_a, F=F)


def _slopes() -> Iterator[Case]:
    def sloped(name: str, means: Any = (0.1, 0.2, 4), *given: Any, slopes: Any = SLOPES_OF_ONE, **more: Any) -> Case:
        return _case("slopes", name, primitives(means, *given, slopes=slopes, **more))

    yield from _along_own_axes(sloped)
    for value in (0, 1e4, 1e8, -1e8, 1e30):
        yield sloped(f"slopes of {value:g}", slopes=value * SLOPES_OF_ONE)
    yield sloped("black in the middle", color=-5.0)
    rng = np.random.default_rng(8)
    many = rng.uniform([-1.2, -1, 3], [1.2, 1, 5], (300, 3))
    various = rng.normal(0, 1, (300, 3, 3))
    yield sloped("300 of a thousandth of a pixel", many, (1e-4, 2e-4, 3e-4), slopes=various)
    yield sloped("300 of various slopes", many, 0.3, slopes=various)
    yield sloped("20 that fill the screen", many[:20], (20, 30, 40), 0.3, slopes=various[:20])
    stack = np.column_stack([np.full((20, 2), 0.1), np.linspace(2.5, 3.5, 20)])
    yield sloped("20 negative lobes on each other", stack, SCALES, 0.7, dog=True, f_a=0.9, slopes=various[:20])


def _curvatures() -> Iterator[Case]:
    def curved(name: str, means: Any = (0.1, 0.2, 4), *given: Any, **more: Any) -> Case:
        more = {"curvatures": CURVATURES_OF_ONE} | more
        return _case("curvatures", name, primitives(means, *given, **more))

    yield from _along_own_axes(curved)
    for value in (0, 1e4, 1e8, -1e8, 1e30):
        yield curved(f"curvatures of {value:g}", curvatures=value * CURVATURES_OF_ONE)
    yield curved("with slopes and cut off", slopes=SLOPES_OF_ONE, normals=NORMAL_OF_ONE)
    rng = np.random.default_rng(10)
    many, various = rng.uniform([-1.2, -1, 3], [1.2, 1, 5], (300, 3)), rng.normal(0, 0.5, (300, 6))
    yield curved("300 of a thousandth of a pixel", many, (1e-4, 2e-4, 3e-4), curvatures=various)
    yield curved("300 of various curvatures", many, 0.3, curvatures=various)
    yield curved("20 that fill the screen", many[:20], (20, 30, 40), 0.3, curvatures=various[:20])


def _cuts() -> Iterator[Case]:
    def cut(name: str, means: Any = (0.1, 0.2, 4), *given: Any, normals: Any = NORMAL_OF_ONE, **more: Any) -> Case:
        return _case("cuts", name, primitives(means, *given, normals=normals, **more))

    yield from _along_own_axes(cut)
    for length in (0, 1e-30, 1e-12, 1e-3, 10, 100, 1e4, 1e8, 1e30):
        yield cut(f"normals of {length:g} times the ordinary", normals=length * NORMAL_OF_ONE)
    yield cut("gone but for what is far out", normals=(-1e4, 0, 0), F=1.6, dog=True)
    yield cut("with slopes", slopes=SLOPES_OF_ONE)
    rng = np.random.default_rng(9)
    many, various = rng.uniform([-1.2, -1, 3], [1.2, 1, 5], (300, 3)), rng.normal(0, 4, (300, 3))
    yield cut("300 of a thousandth of a pixel", many, (1e-4, 2e-4, 3e-4), normals=various)
    yield cut("300 of various normals", many, 0.3, normals=various)
    yield cut("20 that fill the screen", many[:20], (20, 30, 40), 0.3, normals=various[:20])
    stack = np.column_stack([np.full((20, 2), 0.1), np.linspace(2.5, 3.5, 20)])
    yield cut("20 negative lobes on each other", stack, SCALES, 0.7, dog=True, f_a=0.9, normals=various[:20])
    for length in (1e-3, 10, 1e4, 1e30):
        both = {"normals": length * NORMAL_OF_ONE, "second_normals": length * SECOND_NORMAL_OF_ONE}
        yield cut(f"two normals of {length:g} times the ordinary", **both)
    yield cut("two planes that leave a slab", normals=(40, 0, 0), second_normals=(-40, 0, 0))
    yield cut("a second plane alone", normals=None, second_normals=SECOND_NORMAL_OF_ONE)
    yield cut("300 that two planes cut off", many, 0.3, normals=various, second_normals=various[::-1])


def _shifts() -> Iterator[Case]:
    def shifted(name: str, means: Any = (0.1, 0.2, 4), *given: Any, shifts: Any = SHIFTS_OF_ONE, **more: Any) -> Case:
        return _case("shifts", name, primitives(means, *given, shifts=shifts, **more))

    yield from _along_own_axes(shifted)
    for size in (0, 1e-30, 1e-3, 10, 100, 1e4, 1e8, 1e30):
        yield shifted(f"shifts of {size:g} times the ordinary", shifts=size * SHIFTS_OF_ONE)
    for size in (10, 100):
        near = own_views(primitives((0.1, 0.2, 4))) + np.array([0.5, -0.3, 0.2]) / size
        name = f"shifts of {size:g} times the ordinary, seen nearly as on average"
        yield shifted(name, shifts=size * SHIFTS_OF_ONE, mean_view=near)
    for z, name in ((-1, "stored behind the camera, seen before it"), (2, "stored before the camera, seen behind it")):
        yield _case("shifts", name, moved(primitives((0.1, 0.2, z)), (0, 0, -4 * np.sign(z))))
    rng = np.random.default_rng(12)
    many, various = rng.uniform([-1.2, -1, 3], [1.2, 1, 5], (300, 3)), rng.normal(0, 0.5, (300, 3, 3))
    yield shifted("300 of a thousandth of a pixel", many, (1e-4, 2e-4, 3e-4), shifts=various)
    yield shifted("300 of various shifts", many, 0.3, shifts=various)
    yield shifted("20 that fill the screen", many[:20], (20, 30, 40), 0.3, shifts=various[:20])
    rest = {"slopes": SLOPES_OF_ONE, "curvatures": CURVATURES_OF_ONE, "normals": NORMAL_OF_ONE}
    yield shifted("with slopes and curvatures and cut off", **rest)


def _not_finite() -> Iterator[Case]:
    names = ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs", "dog_logit_opacities", "dog_log_scales",
             "color_slopes", "brightness_curvatures", "cut_normals", "second_cut_normals", *SHIFTS.names)  # fmt: skip
    for name in names:
        kinds = [kind for kind, (group, _) in OF_ONE.items() if name in group.names]
        if name == "log_scales":
            kinds = ["slopes", "normals", "shifts"]  # which a size changes, too
        rows = {kind: OF_ONE[kind][1] for kind in kinds}
        for value in (np.nan, np.inf, -np.inf):
            if "logit" in name and not np.isnan(value):
                continue  # an opacity of 0 or 1, see there
            extreme = primitives([(0.1, 0.2, 3), (0.3, 0.2, 3.2)], dog=name.startswith("dog"), **rows)
            broken = getattr(extreme, name).copy()
            broken.reshape(2, -1)[0, -1] = value
            broken_splats = replace(extreme, **{name: broken})
            yield _case("not finite", f"{name} {value:g}", broken_splats, "not drawn, gradient zero")


def _cameras() -> Iterator[Case]:
    ordinary = primitives((0.1, 0.2, 3))
    for width, height in ((1, 1), (1, 97), (97, 1), (17, 33)):
        view = camera(width, height, 0.9 * max(width, height))
        yield _case("camera", f"image of {width}x{height}", ordinary, view=view)
    for degrees in (1, 175, 179.9):
        focal = WIDTH / 2 / np.tan(np.radians(degrees) / 2)
        yield _case("camera", f"field of view {degrees} degrees", ordinary, view=camera(focal=focal))
    for distance in (1e3, 1e6):
        centre = distance * np.array([0.6, -0.64, 0.48])
        far = bystanders().joined(ordinary)
        far = replace(far, means=far.means.astype(float) + centre)
        rows = np.array([far.n_splats - 1])
        yield Case("camera", f"scene {distance:g} from the origin", far, camera(centre=centre), rows)
    for unit in (1e-9, 1e-6, 1e6, 1e9):
        scaled = bystanders().joined(ordinary)
        means, log_scales = scaled.means.astype(float) * unit, scaled.log_scales + np.log(unit)
        scaled, rows = replace(scaled, means=means, log_scales=log_scales), np.array([scaled.n_splats - 1])
        yield Case("camera", f"scene units of {unit:g}", scaled, camera(), rows, near_clip=0.2 * unit)
