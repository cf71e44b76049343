"""Dr.Jit's array types without derivatives, of the variant in use, and its loops: as a type checker can read them.

The kernels of this package bring their own derivatives, so that they take these types and not ``mi.Float``. Dr.Jit's
stubs give such types as ``object`` and the state of a loop as a tuple of one; here types are ``Any`` and a loop returns
what it was given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

import drjit as dr
import mitsuba as mi

State = TypeVar("State", bound=tuple)


@dataclass(frozen=True)
class ArrayTypes:
    """Types of one backend. Those of several values per lane are moved by one wide load, store or scatter."""

    is_llvm: bool
    Float: Any
    Double: Any
    Int: Any
    UInt: Any
    UIntPair: Any
    UIntQuad: Any
    Quad: Any  # of floats
    Floats: Any  # any number of them
    UInts: Any


def array_types() -> ArrayTypes:
    """Of the current variant."""
    return _of_variant(mi.Float)


@lru_cache
def _of_variant(Float: Any) -> ArrayTypes:
    is_llvm = dr.backend_v(Float) == dr.JitBackend.LLVM
    module: Any = dr.llvm if is_llvm else dr.cuda
    scalars = module.Float, module.Float64, module.Int, module.UInt
    whole, floats = (module.Array2u, module.Array4u), (module.Array4f, module.ArrayXf)
    return ArrayTypes(is_llvm, *scalars, *whole, *floats, module.ArrayXu)


@lru_cache(maxsize=256)
def constant(kind: Any, name: str, value: float) -> Any:
    """A number of type ``kind`` that kernels read instead of holding it, on the device once: one memset in all.

    What has another ``name`` is another variable, whatever its value: one for two numbers would be another kernel.
    """
    return dr.opaque(kind, value)


def detached(value: Any) -> Any:
    """The same values, or nested lists of them, in arrays without derivatives."""
    return dr.detach(value, preserve_type=False)


def backward(values: list, adjoints: list) -> None:
    """Add to the gradients of all that ``values`` depend on, given the adjoint of each."""
    for value, adjoint in zip(values, adjoints, strict=True):
        dr.accum_grad(value, adjoint)  # two of them may be one variable, as the channels are in variants with one
    dr.enqueue(dr.ADMode.Backward, values)
    dr.traverse(dr.ADMode.Backward)


def while_loop(
    state: State, cond: Callable[..., Any], body: Callable[..., State], label: str, labels: tuple[str, ...] = ()
) -> State:
    """``dr.while_loop``, within a kernel whatever the flags of Dr.Jit say: where ``JitFlag.SymbolicLoops`` is off,
    frozen functions would be replayed with as many rounds as they were recorded with."""
    loop: Any = dr.while_loop
    return loop(state, cond, body, labels=labels, label=label, mode="symbolic")


def if_stmt(args: tuple, cond: Any, true_fn: Callable[..., Any], false_fn: Callable[..., Any]) -> Any:
    """``dr.if_stmt``: lanes where ``cond`` holds take one function, the others the other one; within a kernel, too."""
    branch: Any = dr.if_stmt
    return branch(args, cond, true_fn, false_fn, mode="symbolic")
