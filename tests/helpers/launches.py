"""What the device is given to do, read from Dr.Jit's kernel history."""

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import pytest

llvm_only = pytest.mark.skipif(not (mi.variant() or "").startswith("llvm"), reason="reads LLVM code; use llvm_ad_rgb")

WARM_UP = 4  # calls; a frozen function records its kernels in the first ones


@dataclass(frozen=True)
class Launch:
    kind: str
    size: int
    operations: int  # of Dr.Jit's representation; 0 unless it is a kernel of ours
    code: str

    @property
    def instructions(self) -> Counter:
        """LLVM instructions by name."""
        return instructions(self.code)


def instructions(code: str) -> Counter:
    found = re.finditer(r"^ +(?:%\S+ = )?(?:tail )?(\w+)(?:.*?@([\w.]+)\()?", code, re.MULTILINE)
    return Counter(f"call {match[2]}" if match[2] else match[1] for match in found)


def launches(run: Callable[[], Any]) -> list[Launch]:
    """All that the device is given to do by a call, once everything is compiled; not what frees memory afterwards."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):  # see ``KernelWatch``
        for _ in range(WARM_UP):
            run()
        dr.sync_thread()
        dr.kernel_history_clear()
        run()
        dr.sync_thread()
        history = [k for k in dr.kernel_history() if k["type"] != dr.KernelType.LLVMHostFunc]
    codes = [k["ir"].getvalue() if "ir" in k else "" for k in history]
    kinds = [str(k["type"]).split(".")[-1] for k in history]
    return [
        Launch(kind, k["size"], k.get("operation_count", 0), code)
        for k, kind, code in zip(history, kinds, codes, strict=True)
    ]


class KernelWatch:
    """Of a ``with`` block: how many kernels it ``launched``, and hashes of those that were not in memory before.

    What warms up is within the block, too, and ends with ``forget``. For frozen functions tell recordings apart by the
    flags of Dr.Jit, and that of the kernel history is one: without, all would be recorded anew in what is watched.
    """

    def __enter__(self) -> "KernelWatch":
        self._flag = dr.scoped_set_flag(dr.JitFlag.KernelHistory)
        self._flag.__enter__()
        self.forget()
        return self

    def forget(self) -> None:
        """Count from here on."""
        dr.sync_thread()
        dr.kernel_history_clear()

    def __exit__(self, *problem: object) -> None:
        dr.eval()
        dr.sync_thread()
        history = dr.kernel_history([dr.KernelType.JIT])
        self._flag.__exit__(*problem)
        self.launched = len(history)
        self.new = [kernel["hash"] for kernel in history if not kernel["cache_hit"] or kernel["cache_disk"]]


def kernels(run: Callable[[], Any]) -> list[tuple[int, int]]:
    """(size, operations) of the kernels of a call."""
    return [(k.size, k.operations) for k in launches(run) if k.kind == "JIT"]


def loop(launched: list[Launch]) -> Launch:
    """The largest kernel with a loop: the compositor, forward or backward."""
    return max((k for k in launched if "_cond:" in k.code), key=lambda k: k.operations)


def branches(code: str) -> list[str]:
    """The LLVM code of each branch that a packet takes where a condition holds in some lane, and else jumps over."""
    guards = re.findall(r"br i1 %\S+, label %(l_\d+_t), label %(l_\d+_next)", code)
    return [code[code.index(f"\n{start}:") : code.index(f"\n{end}:")] for start, end in guards]


def counts_without_compiling(trainer: Any, warm: int, last: int) -> set[int]:
    """Numbers of primitives of a training after its steps from ``warm`` to ``last``, in which no kernel is new."""
    counts = set()
    with KernelWatch() as kernels:
        while trainer.step_count < warm:
            trainer.step()
        kernels.forget()
        while trainer.step_count < last:
            trainer.step()
            counts.add(trainer.optimizer.n)
    assert kernels.launched > 500
    assert not kernels.new
    return counts
