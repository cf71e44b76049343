"""Processors that this one can stand in for: a library in front of libLLVM that tells Dr.Jit of another one.

Dr.Jit asks LLVM which processor it runs on, and takes packets of 16 lanes for AVX-512, of 8 for AVX and of 4 for SSE
4.2 and NEON; it wants FMA of all of them. The library answers these two questions and leaves the rest to LLVM's own.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from mi_dogsplat.support.llvm import find_llvm

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
    """Environment of a process in which Dr.Jit compiles for ``target``; the library is built in ``folder`` by gcc."""
    return os.environ | ({} if target == "own" else {"DRJIT_LIBLLVM_PATH": str(_library(target, folder))})


def _library(target: str, folder: Path) -> Path:
    llvm = find_llvm()
    if llvm is None:
        raise SystemExit("needs an LLVM for Dr.Jit")
    cpu, features = TARGETS[target]
    folder = folder / target
    folder.mkdir()
    source, library = folder / "target.c", folder / f"libLLVM-{llvm.version[0]}.so"
    source.write_text(SOURCE)
    answers = f'-DCPU="{cpu}"', f'-DFEATURES="{",".join("+" + name for name in features.split())}"'
    # linked to the real library by its path, so that Dr.Jit finds all other functions behind this one
    command = "gcc", "-shared", "-fPIC", *answers, str(source), "-o", str(library)
    subprocess.run([*command, "-Wl,--no-as-needed", os.path.realpath(llvm.path)], check=True)
    return library
