"""BSDFs of Mitsuba that several shaders become."""

from __future__ import annotations

from .export import Plugin, rgb

SMOOTH = 0.02  # roughness below which a mirror is perfect
LEAST_IOR = 1e-5  # of Cycles, which takes smaller ones as this
BLACK: Plugin = {"type": "diffuse", "reflectance": rgb((0, 0, 0))}


def two_sided(bsdf: Plugin) -> Plugin:
    """The same from the back."""
    return {"type": "twosided", "bsdf": bsdf}


def refracts(bsdf: Plugin) -> bool:
    """Whether light is bent on its way through it, or through a part of it."""
    own = bsdf["type"].endswith("dielectric") and bsdf["type"] != "thindielectric" or "spec_trans" in bsdf
    return own or any(refracts(inner) for inner in bsdf.values() if isinstance(inner, dict) and "type" in inner)


def glass(roughness: float, ior: float, tints: dict[str, Plugin]) -> Plugin:
    """A dielectric; ``ior`` 1 bends nothing."""
    values = {"int_ior": max(ior, 1.0001), "ext_ior": 1.0, **tints}
    if roughness < SMOOTH:
        return {"type": "dielectric", **values}
    return {"type": "roughdielectric", "distribution": "ggx", "alpha": roughness**2, **values}
