"""Processors that this one can stand in for: a library in front of libLLVM that tells Dr.Jit of another one.

Dr.Jit asks LLVM which processor it runs on, and takes packets of 16 lanes for AVX-512, of 8 for AVX and of 4 for SSE
4.2 and NEON; it wants FMA of all of them. The library answers these two questions and leaves the rest to LLVM's own.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from pathlib import Path

from mi_dogsplat.support.llvm import explain, find_llvm

SOURCE = """#include <string.h>
char *LLVMGetHostCPUName(void) { return strdup(CPU); }
char *LLVMGetHostCPUFeatures(void) { return strdup(FEATURES); }
"""
SSE = "64bit cmov cx8 cx16 fxsr mmx popcnt sahf sse sse2 sse3 ssse3 sse4.1 sse4.2 fma"
TARGETS = {  # name: (processor, its features); the machine itself is "own"
    "avx2": ("haswell", f"{SSE} xsave avx avx2 bmi bmi2 lzcnt movbe f16c"),
    "sse": ("nehalem", SSE),
}


def environment(target: str, folder: Path) -> dict[str, str]:
    """Environment of a process in which Dr.Jit compiles for ``target``; the library is built in ``folder``."""
    if target == "own":
        return dict(os.environ)
    cpu, features = TARGETS[target]
    return os.environ | {"DRJIT_LIBLLVM_PATH": str(library(folder, cpu, features))}


def library(folder: Path, cpu: str, features: str) -> Path:
    """A library that is LLVM but for what it says of the processor; needs Linux and a C compiler.

    Args:
        features: in LLVM's words, separated by blanks; those that are not named are not there.
    """
    llvm = find_llvm()
    if llvm is None:
        raise SystemExit(explain())
    path = folder / f"libLLVM-{llvm.version[0]}.so"
    answers = f'-DCPU="{cpu}"', f'-DFEATURES="{",".join("+" + name for name in features.split())}"'
    # linked to LLVM by its path, so that Dr.Jit finds all other functions behind this library
    command = ["cc", "-shared", "-fPIC", *answers, "-o", str(path), "-Wl,--no-as-needed", llvm.path, "-x", "c", "-"]
    subprocess.run(command, input=SOURCE, text=True, check=True, capture_output=True)
    return path


def can_build() -> bool:
    """Whether ``library`` can be made, and its processors run, on this machine."""
    return platform.system() == "Linux" and platform.machine() == "x86_64" and shutil.which("cc") is not None
