"""Which of Mitsuba's variants the plugins run in, and what the others are told.

Splats have three channels and are evaluated in wide arrays: variants of RGB, and of luminance, on LLVM or CUDA. In
the others the plugins exist only to say so, which is clearer than "plugin not found".
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .errors import DataError
from .llvm import explain, find_llvm
from .threads import fit_threads

UNSUPPORTED = ("scalar", "spectral", "polarized")
SET_ONE = 'call mi_dogsplat.support.variants.set_variant("auto") first, or mi.set_variant("llvm_ad_rgb")'


def supported(variant: str) -> bool:
    """Whether the plugins run in a variant."""
    return not any(word in variant for word in UNSUPPORTED)


def require_variant() -> str:
    """The active variant. Raises ``DataError`` if none is set: Mitsuba's own error suggests one of scalars."""
    variant = mi.variant()
    if variant is None:
        raise DataError("Mitsuba", "no variant is set", SET_ONE)
    return variant


def require_arrays(wanted: str = "auto") -> None:
    """Raise ``DataError`` unless a variant is set that computes with arrays, and that is ``wanted`` (``auto``: any)."""
    variant = require_variant()
    if "scalar" in variant:
        raise DataError("Mitsuba", f"the variant {variant} computes no arrays", SET_ONE)
    if wanted not in ("auto", variant):
        raise DataError("--variant", f"{wanted} is asked for, and {variant} is set", f'call mi.set_variant("{wanted}")')


def require_supported(name: str) -> None:
    """Raise ``DataError`` unless a variant is set, and ``RuntimeError`` for ``name`` if no plugins run in it."""
    if not supported(variant := require_variant()):
        raise _unavailable(name, variant)


def register_unavailable(variant: str) -> None:
    """Register plugins that raise ``RuntimeError`` in a variant that is not supported; it must be the active one."""
    for name, register in (
        ("dog", mi.register_shape),
        ("dogsplat", mi.register_integrator),
        ("dogpath", mi.register_integrator),
    ):

        def fail(props: mi.Properties, name: str = name):
            raise _unavailable(name, variant)

        register(name, fail)


def _unavailable(name: str, variant: str) -> RuntimeError:
    return RuntimeError(f"{name}: not available in the variant {variant}; use llvm_ad_rgb or cuda_ad_rgb")


def set_variant(name: str) -> None:
    """Make a Mitsuba variant the active one; ``auto`` is CUDA where there is a GPU, else LLVM.

    Raises ``DataError`` that names the flag ``--variant`` if it cannot be had.
    """
    available = mi.variants()
    if name == "auto":
        name = "cuda_ad_rgb" if "cuda_ad_rgb" in available and dr.has_backend(dr.JitBackend.CUDA) else "llvm_ad_rgb"
    if name not in available or not name.endswith("ad_rgb"):
        raise DataError("--variant", f'"{name}" cannot be used', "use auto, llvm_ad_rgb or cuda_ad_rgb")
    if name.startswith("cuda") and not dr.has_backend(dr.JitBackend.CUDA):
        raise DataError("--variant", "there is no usable CUDA GPU", "use --variant llvm_ad_rgb")
    if name.startswith("llvm"):
        _require_llvm()
    fit_threads()
    mi.set_variant(name)


def _require_llvm() -> None:
    """Raise ``DataError`` unless Dr.Jit can compile for this processor.

    Dr.Jit itself says why on standard error, and then that there is no libLLVM even where there is one.
    """
    llvm = find_llvm()
    if llvm is None:
        raise DataError("--variant", "no usable LLVM", explain())
    if not dr.has_backend(dr.JitBackend.LLVM):
        problem = f"Dr.Jit cannot compile for this processor with {llvm.path}"
        remedy = "use a processor with FMA (all since 2013) and an LLVM that was built for it (DRJIT_LIBLLVM_PATH)"
        raise DataError("--variant", problem, remedy)
