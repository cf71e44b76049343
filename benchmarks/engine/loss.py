"""Time of the training loss with its gradient, ours beside SSIM through ``dr.convolve`` and Dr.Jit's AD.

Run as ``python -m benchmarks loss [width height]`` on a quiet machine; prints medians in milliseconds. All
are timed in alternation in one process, so that a busy machine slows all.
"""

import argparse
import statistics
import time
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.images.blur import gaussian_window
from mi_dogsplat.training.images.loss import C1, C2, PhotometricLoss

from ..flags import at_least_one

REPEATS = 40


def mean(image):
    return dr.convolve(image, gaussian_window(), axis=(1, 2))


def convolve_loss(image, y, my, yy):
    """0.8 L1 + 0.2 (1 - SSIM) of [3, H, W] by ``dr.convolve``, given E[y] and E[y^2]; gradient by AD."""
    dr.enable_grad(image)
    x = dr.clip(image, 0, 1)
    mx = mean(x)
    covariance, variances = mean(x * y) - mx * my, mean(x * x) - mx * mx + yy - my * my
    ssim = (2 * mx * my + C1) * (2 * covariance + C2) / ((mx * mx + my * my + C1) * (variances + C2))
    loss = 0.8 * dr.mean(dr.abs(x - y), axis=None) + 0.2 * (1 - dr.mean(ssim, axis=None))
    dr.backward(loss)
    gradient = dr.grad(image)
    dr.disable_grad(image)
    dr.eval(loss, gradient)
    return loss, gradient


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks loss", description=(__doc__ or "").partition("\n")[0])
    words = "width and height, pixels"
    parser.add_argument("size", type=at_least_one, nargs="*", default=[400, 300], metavar="N", help=words)
    args = parser.parse_args(arguments)
    if len(args.size) != 2:
        parser.error("give width and height, or neither")
    width, height = args.size
    set_variant("llvm_ad_rgb")
    rng = np.random.default_rng(0)
    y = rng.random((3, height, width), np.float32)
    x = (y + rng.normal(0, 0.1, y.shape)).astype(np.float32)
    loss, Float = PhotometricLoss(), cast(Any, dr.detached_t(mi.Float))
    target = loss.target(y.transpose(1, 2, 0))
    planes, joined = [Float(p.ravel()) for p in x], Float(x.ravel())
    y_tensor: Any = mi.TensorXf(y)
    tensors = mi.TensorXf(x), y_tensor, mean(y_tensor), mean(y_tensor * y_tensor)
    dr.eval(planes, joined, tensors)
    runs = {
        "ours, three planes": lambda: dr.eval(loss.value_and_gradient(planes, target)),
        "ours, joined planes": lambda: dr.eval(loss.value_and_gradient(joined, target)),
        "dr.convolve and AD": lambda: convolve_loss(*tensors),
        "preparing a target": lambda: loss.target(y.transpose(1, 2, 0)),
    }
    ours, theirs = loss.value_and_gradient(joined, target)[3].numpy(), convolve_loss(*tensors)[1].numpy()
    print(f"{width}x{height}; largest difference of the gradients / largest gradient: "
          f"{np.abs(ours - theirs.ravel()).max() / np.abs(ours).max():.1e}")  # fmt: skip
    seconds = {name: [] for name in runs}
    for repeat in range(REPEATS + 3):  # the first three warm up
        for name, run in runs.items():
            dr.sync_thread()
            start = time.perf_counter()
            run()
            dr.sync_thread()
            if repeat >= 3:
                seconds[name].append(time.perf_counter() - start)
    for name, times in seconds.items():
        print(f"{name:22s}{1e3 * statistics.median(times):8.2f} ms   (fastest {1e3 * min(times):.2f})")

