"""Whether Dr.Jit computes on the GPU, and whether scenes can be loaded there: ``python -m scripts.gpu.probe``.

Exit status 0: both; ``WITHOUT_OPTIX``: arrays only, as every scene with a shape needs OptiX; 1: no arrays either.
"""

import sys

import drjit as dr
import mi_dogsplat  # noqa: F401  (before mitsuba: chooses the LLVM)
import mitsuba as mi

from .steps import WITHOUT_OPTIX


def main() -> int:
    mi.set_variant("cuda_ad_rgb")
    if dr.sum(dr.arange(mi.Float, 1000))[0] != 499500:
        print("a sum of 1000 numbers on the GPU is wrong")
        return 1
    print("arrays: computed on the GPU")
    try:
        scene = mi.load_dict({"type": "scene", "sphere": {"type": "sphere"}})
        hit = scene.ray_intersect(mi.Ray3f([0, 0, -3], [0, 0, 1])).t[0]
    except RuntimeError as error:
        print(f"scenes: {error}")
        return WITHOUT_OPTIX
    print(f"scenes: a ray meets a sphere at {hit:.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
