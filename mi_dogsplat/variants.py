"""Which of Mitsuba's variants the plugins run in, and what the others are told.

Splats have three channels and are evaluated in wide arrays: variants of RGB, and of luminance, on LLVM or CUDA. In
the others the plugins exist only to say so, which is clearer than "plugin not found".
"""

from __future__ import annotations

import mitsuba as mi

UNSUPPORTED = ("scalar", "spectral", "polarized")


def supported(variant: str) -> bool:
    """Whether the plugins run in a variant."""
    return not any(word in variant for word in UNSUPPORTED)


def refuse(variant: str) -> None:
    """Register plugins that raise ``RuntimeError`` in a variant that is not supported; it must be the active one."""
    for name, register in (("dog", mi.register_shape), ("dogsplat", mi.register_integrator)):

        def fail(props: mi.Properties, name: str = name):
            raise RuntimeError(f"{name}: not available in the variant {variant}; use llvm_ad_rgb or cuda_ad_rgb")

        register(name, fail)
