"""How stiff a real model is: the spectrum of the Gauss-Newton matrix, what couples, and the noise of single views.

The mean squared error of all views has the Gauss-Newton matrix

    G = 2 / (3 pixels) Σ_views Jᵀ J,    J: derivative of the image by the raw parameters,

which is its Hessian where the pictures fit. It is never formed: J v is the engine's forward mode, Jᵀ u its reverse
mode. Its diagonal D is Σ_views E[(Jᵀ u)²] over random signs u, which is never negative. Eigenvalues are those of
Lanczos' tridiagonal matrix; from random starts it also tells how many there are of each size (Golub and Welsch 1969).

Adam's steps do not depend on the size of D, but on what D^-1/2 G D^-1/2 has outside of its diagonal: its largest
eigenvalue is 1 where nothing couples, and k where k parameters do the same to the pictures. Within one kind of
parameter that is a coupling between primitives. How many take part: 1 / Σ v⁴ of the eigenvector v, whose length is 1.

Noise: g_v is the gradient of the training loss by one view, g their mean. The variance of g_v over |g|² is the number
of views in a batch whose noise is as large as the gradient (McCandlish et al. 2018), once as it is, once with each
parameter in units of its root mean square, as for Adam.

    python -m benchmarks curvature MODEL DATA [--downscale K] [--views N] [--steps N] [--probes N]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.engine.arrays import backward
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, device_array, upload
from mi_dogsplat.engine.rasterize import rasterize
from mi_dogsplat.render.picture import background_color
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.images.photographs import Photographs
from mi_dogsplat.training.initialize import initial_splats

FAINT = 1e-14  # of the largest curvature of a kind; what is below no view sees
DECADES = (10.0, 1.0, 0.1)

Product = Callable[[np.ndarray], np.ndarray]


class Jacobian:
    """J of a model in views, [3 pixels of all views, parameters], by its products; parameters as one flat vector."""

    def __init__(self, splats: Splats, cameras: Sequence[Camera], options: RasterOptions, background: float = 0.0):
        self.params, self.options, self.background = upload(splats), options, background
        self.names = [name for name in RAW + RAW_DOG if name in self.params]
        self.sizes = [getattr(splats, name).size for name in self.names]
        self.cameras = [DeviceCamera.upload(camera) for camera in cameras]
        self.pixels = sum(camera.width * camera.height for camera in cameras)
        sh_size = splats.sh_coeffs[0].size if splats.n_splats else 1
        every = np.split(np.arange(sum(self.sizes)), np.cumsum(self.sizes)[:-1])
        self.kinds = dict(zip(self.names, every, strict=True))
        sh = self.kinds.pop("sh_coeffs").reshape(-1, sh_size)
        self.kinds |= {"sh_dc": sh[:, :3].ravel()} | ({"sh_rest": sh[:, 3:].ravel()} if sh_size > 3 else {})

    def _planes(self, camera: DeviceCamera, tangent: np.ndarray | None = None) -> tuple[list[Any], list[Any]]:
        """(parameters, picture), attached."""
        leaves = {name: mi.Float(self.params[name]) for name in self.names}
        dr.enable_grad(leaves)
        if tangent is not None:
            for leaf, part in zip(leaves.values(), np.split(tangent, np.cumsum(self.sizes)[:-1]), strict=True):
                dr.set_grad(leaf, device_array(part))
        frame = rasterize(self.params | leaves, camera, self.options)
        return list(leaves.values()), [dr.fma(frame.T, self.background, color) for color in frame.colors]

    def picture(self, view: int) -> list[Any]:
        """Of a view: three planes."""
        _, planes = self._planes(self.cameras[view])
        return dr.detach(planes)

    def forward(self, view: int, tangent: np.ndarray) -> list[Any]:
        """J v in a view: three planes."""
        leaves, planes = self._planes(self.cameras[view], tangent)
        dr.enqueue(dr.ADMode.Forward, leaves)
        dr.traverse(dr.ADMode.Forward)
        found = [mi.Float(dr.grad(plane)) for plane in planes]
        dr.eval(found)
        return found

    def backward(self, view: int, adjoint: list[Any]) -> np.ndarray:
        """Jᵀ u of a view, float64."""
        leaves, planes = self._planes(self.cameras[view])
        backward(planes, adjoint)
        return np.concatenate([dr.grad(leaf).numpy() for leaf in leaves]).astype(np.float64)

    @property
    def scale(self) -> float:
        """Of JᵀJ in G."""
        return 2 / (3 * self.pixels)

    def gauss_newton(self, vector: np.ndarray) -> np.ndarray:
        """G v."""
        products = [self.backward(view, self.forward(view, vector)) for view in range(len(self.cameras))]
        return self.scale * np.sum(products, axis=0)

    def diagonal(self, probes: int, rng: np.random.Generator) -> np.ndarray:
        """D, from ``probes`` pictures of random signs per view."""
        total = np.zeros(sum(self.sizes))
        for view, camera in enumerate(self.cameras):
            for _ in range(probes):
                signs = 2.0 * rng.integers(0, 2, (3, camera.width * camera.height)) - 1
                total += self.backward(view, [device_array(row) for row in signs]) ** 2
        return self.scale * total / probes


@dataclass(frozen=True)
class Ritz:
    """Eigenvalues that Lanczos has found, rising, and what the start has of each; the vector of the largest."""

    values: np.ndarray
    weights: np.ndarray
    top: np.ndarray

    def share_above(self, value: float) -> float:
        """Of all eigenvalues, for a start of random signs."""
        return float(self.weights[self.values > value].sum())

    @property
    def participants(self) -> float:
        """Entries that the vector of the largest eigenvalue is spread over."""
        return float(1 / np.sum(self.top**4))


def lanczos(product: Product, start: np.ndarray, steps: int) -> Ritz:
    """Of a symmetric matrix; every vector is made orthogonal to all before it, twice."""
    basis, diagonal, beside = [start / np.linalg.norm(start)], [], []
    for _ in range(min(steps, len(start))):
        w = product(basis[-1])
        diagonal.append(float(basis[-1] @ w))
        for _ in range(2):
            stacked = np.array(basis)
            w = w - stacked.T @ (stacked @ w)
        length = float(np.linalg.norm(w))
        if length <= 1e-6 * abs(diagonal[0]):  # the products are float32
            break
        beside.append(length)
        basis.append(w / length)
    k = len(diagonal)
    values, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(beside[: k - 1], 1) + np.diag(beside[: k - 1], -1))
    return Ritz(values, vectors[0] ** 2, np.array(basis[:k]).T @ vectors[:, -1])


def scaled(product: Product, diagonal: np.ndarray, active: np.ndarray) -> Product:
    """D^-1/2 G D^-1/2 of the parameters ``active``, indices; vectors have an entry for each of them."""

    def apply(vector: np.ndarray) -> np.ndarray:
        whole = np.zeros(len(diagonal))
        whole[active] = vector / np.sqrt(diagonal[active])
        return product(whole)[active] / np.sqrt(diagonal[active])

    return apply


def noise(gradients: np.ndarray) -> tuple[float, float]:
    """Views whose mean has as much noise as signal, from gradients [views, parameters]: as they are, and for Adam."""
    mean, square = gradients.mean(0), np.square(gradients).mean(0)
    seen = square > 0
    signal = mean[seen] ** 2
    plain = (square[seen] - signal).sum() / signal.sum()
    adam = (1 - signal / square[seen]).sum() / (signal / square[seen]).sum()
    return float(plain), float(adam)


def view_gradients(splats: Splats, dataset: Dataset, background: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """[views, parameters] of the training loss, and which parameters are of which kind."""
    photographs = Photographs(dataset, background)
    options = RasterOptions(sh_degree=splats.sh_degree)
    jacobian = Jacobian(splats, [view.camera for view in dataset.train], options, background)
    rows = []
    for view in range(len(photographs)):
        frame = rasterize(jacobian.params, photographs.cameras[view], options)
        _, _, adjoint = photographs.compare(photographs.over_background(frame), view, 0)
        rows.append(jacobian.backward(view, adjoint))
    return np.array(rows), jacobian.kinds


def print_spectrum(jacobian: Jacobian, steps: int, probes: int) -> None:
    """A row per kind of parameter, and one for all of them."""
    rng = np.random.default_rng(0)
    diagonal = jacobian.diagonal(probes, rng)
    kinds = {name: at[diagonal[at] > FAINT * diagonal[at].max()] for name, at in jacobian.kinds.items()}
    kinds["all"] = np.sort(np.concatenate(list(kinds.values())))
    print("                                         curvature         D^-1/2 G D^-1/2   eigenvalues (%) above")
    heads = "  ".join(f"{value:g}".rjust(5) for value in DECADES)
    print(f"{'kind':20s}{'seen':>8s}   5 %     median  95 %     largest   largest  take part   {heads}")
    for name, active in kinds.items():
        identity = np.ones(len(diagonal))
        start = rng.choice([-1.0, 1.0], len(active))
        largest = lanczos(scaled(jacobian.gauss_newton, identity, active), start, steps // 2).values[-1]
        ritz = lanczos(scaled(jacobian.gauss_newton, diagonal, active), start, steps)
        quantiles = "  ".join(f"{q:7.1e}" for q in np.quantile(diagonal[active], (0.05, 0.5, 0.95)))
        resolved = ritz.values[-1] / steps**2  # Lanczos does not tell smaller ones apart
        shares = "  ".join(f"{100 * ritz.share_above(v):5.1f}" if v > resolved else "    -" for v in DECADES)
        coupled = f"{ritz.values[-1]:8.1f}  {ritz.participants:9.0f}"
        print(f"{name:20s}{len(active):8d}  {quantiles}  {largest:8.1e}  {coupled}   {shares}")


def print_noise(title: str, splats: Splats, dataset: Dataset, background: float) -> None:
    """A row per kind of parameter."""
    gradients, kinds = view_gradients(splats, dataset, background)
    print(f"{title}, {splats.n_splats} primitives: views whose noise is as large as the gradient (as it is, for Adam)")
    for name, at in (kinds | {"all": np.arange(gradients.shape[1])}).items():
        if np.any(gradients[:, at]):
            print("  {:20s} {:8.1f} {:8.1f}".format(name, *noise(gradients[:, at])))


def main(flags: list[str]) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks curvature", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("model", help="a model .ply")
    parser.add_argument("data", help="the data set that it was trained on")
    parser.add_argument("--downscale", type=int, default=4, help="of the views (default: 4)")
    parser.add_argument("--views", type=int, default=8, help="of the matrix; the noise is of all (default: 8)")
    parser.add_argument("--steps", type=int, default=32, help="of Lanczos (default: 32)")
    parser.add_argument("--probes", type=int, default=32, help="per view, for the diagonal (default: 32)")
    args = parser.parse_args(flags)
    set_variant("llvm_ad_rgb")
    splats, dataset = read_ply(args.model), load_dataset(args.data, args.downscale)
    background = background_color("auto", dataset.has_alpha)
    some = dataset.train[:: max(1, len(dataset.train) // args.views)][: args.views]
    options = RasterOptions(sh_degree=splats.sh_degree)
    print(f"{splats.n_splats} primitives, {splats.n_dog} of them DoG; {len(some)} views of {len(dataset.train)}")
    print_spectrum(Jacobian(splats, [view.camera for view in some], options, background), args.steps, args.probes)
    start = initial_splats(TrainConfig(args.data, sh_degree=splats.sh_degree), dataset, splats.n_splats)
    print_noise("as training starts", start, dataset, background)
    print_noise("trained", splats, dataset, background)
