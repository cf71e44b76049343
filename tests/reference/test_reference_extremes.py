"""Gradients of the float64 twin at extremes, against differences in 70 digits."""

from decimal import Decimal, localcontext
from functools import lru_cache

import numpy as np
from every_pair import every_pair
from mi_dogsplat import reference
from mi_dogsplat.reference.forward import raw_names
from mi_dogsplat.reference.gradients import gradients_tiled
from splat_scenes import axis_rotation, make_splats, tilted_camera

BACKGROUND = (0.2, -0.3, 0.6)


@lru_cache(maxsize=10_000)
def exp(value: Decimal) -> Decimal:
    """In as many digits as all of this file has. Most are asked for again with the next parameter that is changed."""
    return value.exp()


def exact_loss(raw: dict, color: np.ndarray, camera, adjoint: np.ndarray, antialiased: bool) -> Decimal:
    """sum(adjoint * image) of one DoG primitive without view dependence, below .99; arrays of Decimal."""
    number = np.vectorize(Decimal, otypes=[object])
    W, t, low_pass = number(camera.w2c[:3, :3]), number(camera.w2c[:3, 3]), Decimal(reference.LOW_PASS)
    focal, centre = number([camera.fx, camera.fy]), number([camera.cx, camera.cy])
    margin = number([0.15 * camera.width, 0.15 * camera.height])
    size = number([camera.width, camera.height])
    position = W @ raw["means"] + t
    tangents = position[:2] / position[2]
    clamped = np.clip(tangents, -(centre + margin) / focal, (size + margin - centre) / focal)
    JW = (focal / position[2])[:, None] * (W[:2] - clamped[:, None] * W[2])
    x, y, z, w = raw["quats"] / (raw["quats"] @ raw["quats"]).sqrt()
    R = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                  [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                  [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])
    pixels = number(np.mgrid[: camera.width, : camera.height].reshape(2, -1) + 0.5)  # [2, P] x, y
    offsets = pixels - (focal * tangents + centre)[:, None]

    dx, dy = offsets

    def axes(log_scales):
        return JW @ R * np.array([exp(s) for s in log_scales])

    def kernel(logits, log_scales):
        A = axes(log_scales)
        xx, xy, yy = A[0] @ A[0] + low_pass, A[0] @ A[1], A[1] @ A[1] + low_pass
        det = xx * yy - xy * xy
        ratio = ((xx - low_pass) * (yy - low_pass) - xy * xy) / det
        opacity = max(Decimal(reference.MIN_ANTIALIAS_RATIO), ratio).sqrt() if antialiased else Decimal(1)
        for logit in logits:
            opacity /= 1 + exp(-logit)
        return np.array([opacity * exp(q / -2) for q in (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / det])

    opacity, scales = raw["logit_opacities"], raw["log_scales"]
    alpha = kernel([opacity], scales) - kernel([opacity, raw["dog_logit_opacities"]], scales + raw["dog_log_scales"])
    A = axes(scales)
    covariance = A @ A.T + low_pass * np.eye(2, dtype=int)
    inverse = np.array([[covariance[1, 1], -covariance[0, 1]], [-covariance[1, 0], covariance[0, 0]]])
    inverse /= covariance[0, 0] * covariance[1, 1] - covariance[0, 1] ** 2
    w = offsets.T @ (inverse @ A)  # [P, 3]
    colors = color + w @ raw["color_slopes"] if "color_slopes" in raw else color
    if "brightness_curvatures" in raw:
        xx, yy, zz, xy, xz, yz = raw["brightness_curvatures"]
        x, y, z = w.T
        brighter = (xx * x * x + yy * y * y + zz * z * z) / 2 + xy * x * y + xz * x * z + yz * y * z
        colors = colors + brighter[:, None]
    plane = Decimal(-4)
    for normal in [raw[name] for name in ("cut_normals", "second_cut_normals") if name in raw]:
        h = inverse @ A @ normal  # per pixel
        h = h * min(Decimal(1), 16 / max(Decimal(1), (h @ h).sqrt()))
        alpha = alpha * np.array([(1 + exp(plane)) / (1 + exp(plane - n)) for n in offsets.T @ h])
    over = (colors - number(BACKGROUND)) * number(adjoint.swapaxes(0, 1).reshape(-1, 3))
    return (alpha[:, None] * over).sum()


def exact_gradients(splats, camera, adjoint: np.ndarray, antialiased: bool) -> dict[str, np.ndarray]:
    """Differences in 70 digits of all but the coefficients; a step is 1e-20 of the largest value of its kind."""
    number = np.vectorize(Decimal, otypes=[object])
    raw = {name: number(getattr(splats, name)) for name in raw_names(splats) if name != "sh_coeffs"}
    gradients = {name: np.zeros(values.shape) for name, values in raw.items()}
    (color,) = number(reference.project(splats, camera).colors)
    with localcontext() as context:
        context.prec = 70
        for name, values in raw.items():
            step = max(map(abs, values.ravel())) * Decimal("1e-20")
            for index in np.ndindex(values.shape):
                value, sides = values[index], []
                for side in (step, -step):
                    values[index] = value + side
                    one = {key: array[0] for key, array in raw.items()}
                    sides.append(exact_loss(one, color, camera, adjoint, antialiased))
                values[index] = value
                gradients[name][index] = (sides[0] - sides[1]) / (2 * step)
    return gradients


EXTREMES = {
    "round": {},
    "needle": {"scales": (0.5, 5e-7, 5e-7)},
    "long needle": {"scales": (1e3, 1e-3, 1e-3)},
    "disc": {"scales": (1, 1e-6, 1)},
    "tiny": {"scales": 1e-12},
    "huge": {"scales": (1e6, 2e6, 3e6)},
    "huge needle": {"scales": (1e6, 1, 1)},
    "huge quaternion": {"scales": (0.5, 5e-7, 0.1), "length": 1e15},
    "tiny quaternion": {"scales": (0.5, 5e-7, 0.1), "length": 1e-15},
    "three sizes": {"scales": (1e-12, 1, 1e6)},
    "far": {"means": (300, 200, 1e4), "scales": (1e3, 2e3, 500)},
    "beside the image": {"means": (6, 1, 2), "scales": (6, 3, 4)},
}


@every_pair(
    case=EXTREMES, varies=["even", "slopes", "slopes and cut", "steep cut", "cut twice", "curvatures", "all"],
    antialiased=[False, True],
)  # fmt: skip
def test_gradients_of_extreme_primitives_have_ten_digits(case, antialiased, varies):
    changes = {"means": (0.1, -0.05, 2), "scales": (0.3, 0.2, 0.1), "length": 1.0, **EXTREMES[case]}
    quat = changes.pop("length") * axis_rotation([0.3, -0.5, 0.8], 1.1)[1]
    splats = make_splats(changes.pop("means"), opacities=0.7, colors=(0.2, 0.5, 0.9), quats=quat, dog=[0],
                         f_a=0.6, F=(1.5, 1.2, 1.8), **changes)
    varies = "slopes, curvatures and cut twice" if varies == "all" else varies
    if "slopes" in varies:
        splats.slope_index, splats.color_slopes = np.array([0]), np.random.default_rng(1).normal(size=(1, 3, 3))
    if "curvatures" in varies:
        splats.curvature_index = np.array([0])
        splats.brightness_curvatures = np.random.default_rng(2).normal(size=(1, 6))
    if "cut" in varies:
        steep = 30 if "steep" in varies else 1
        splats.cut_index, splats.cut_normals = np.array([0]), steep * np.array([[3.0, -2, 1.5]])
    if "twice" in varies:
        splats.second_cut_index, splats.second_cut_normals = np.array([0]), np.array([[1.0, 3, -2]])
    # One axis is 10⁶ times the others, and so is the rounding of products of two: 5e-10 of a turn is found.
    needle_curves = case == "huge needle" and "curvatures" in varies
    camera = tilted_camera(5, 4, f=4.0)
    adjoint = np.random.default_rng(0).normal(size=(4, 5, 3))
    got = gradients_tiled(splats, camera, adjoint, BACKGROUND, antialiased=antialiased, min_alpha=0,
                          min_transmittance=0)
    for name, values in exact_gradients(splats, camera, adjoint, antialiased).items():
        assert values.any()
        rtol = 1e-9 if varies == "steep cut" or needle_curves else 1e-10  # whose n.w may be in the hundreds
        atol = 0 if varies == "even" else rtol * np.abs(values).max()  # a turn of a needle moves its slopes about
        np.testing.assert_allclose(got[name], values, rtol=rtol, atol=atol, err_msg=name)
