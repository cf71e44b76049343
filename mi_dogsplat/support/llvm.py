"""Finds an LLVM that Dr.Jit can use, before Dr.Jit loads one that kills the process.

Dr.Jit 1.5 loads libLLVM with ``import drjit``, so with ``import mitsuba`` (see /proc/self/maps): the
file in ``DRJIT_LIBLLVM_PATH``, else "libLLVM.so", else the last of a glob. Below 17 a kernel with a float
min or max aborts the whole process ("Cannot select: fminimum"): an old library is worse than none. Versions
come from file names, because two LLVMs loaded into one process may clash; a file whose name does not tell is
asked in a subprocess. Users of CUDA need no LLVM: nothing here fails when there is none.
"""

from __future__ import annotations

import glob
import os
import platform
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass

MIN_VERSION = 17
_ENVIRONMENT = "DRJIT_LIBLLVM_PATH"
# libLLVM-15.so.1, libLLVM-14.0.6.so.1, libLLVM.so.19.1, libLLVM-19.dylib; not Rust's libLLVM-17-rust-1.78.so
_FILE_NAME = re.compile(r"LLVM-C\.dll|libLLVM(?:-(?P<dash>\d[\d.]*?))?\.(?:so|dylib)(?:\.(?P<end>\d[\d.]*))?")
_ASK_VERSION = """
import ctypes, sys
numbers = [ctypes.c_uint() for _ in range(3)]
ctypes.CDLL(sys.argv[1]).LLVMGetVersion(*map(ctypes.byref, numbers))
print(*(n.value for n in numbers))
"""


@dataclass(frozen=True)
class LLVM:
    """A usable LLVM shared library."""

    path: str
    version: tuple[int, ...]  # (19, 1) or longer


def find_llvm() -> LLVM | None:
    """The library named by ``DRJIT_LIBLLVM_PATH`` if it is usable, else the newest usable one, else None."""
    named = _usable(os.environ.get(_ENVIRONMENT, ""))
    if named:
        return named
    paths = [path for pattern in search_patterns() for path in sorted(glob.glob(pattern))]
    found = (_usable(path) for path in paths if _FILE_NAME.fullmatch(os.path.basename(path)))
    return max(filter(None, found), key=lambda llvm: llvm.version, default=None)


def choose_llvm() -> None:
    """Point Dr.Jit at the best LLVM there is; without effect once drjit is imported. Never raises."""
    best = find_llvm()
    if best:
        os.environ[_ENVIRONMENT] = best.path


def check_loaded_llvm() -> None:
    """Raise ``RuntimeError`` (one line) if an LLVM variant is active whose LLVM would abort the process.

    Cheap. Asks Dr.Jit itself: /proc/self/maps may also show libraries of others, such as Mesa's own LLVM.
    """
    import drjit
    import mitsuba

    # An old LLVM harms nobody who uses CUDA.
    if not (mitsuba.variant() or "").startswith("llvm"):
        return
    version = drjit.detail.llvm_version()
    if version[0] >= MIN_VERSION:
        return
    best = find_llvm()
    remedy = f"import mi_dogsplat before mitsuba, or set {_ENVIRONMENT}={best.path}" if best else explain()
    loaded = ".".join(map(str, version))
    raise RuntimeError(f"Dr.Jit has loaded LLVM {loaded}, which aborts on float min and max; {remedy}")


def explain() -> str:
    """One line: how to get a usable LLVM on this platform."""
    if sys.platform == "darwin":
        command = "brew install llvm"
    elif sys.platform == "win32":
        command = "winget install LLVM.LLVM"
    elif shutil.which("apt-get"):
        command = "apt-get install libllvm19"
    elif shutil.which("dnf"):
        command = "dnf install llvm-libs"
    elif shutil.which("pacman"):
        command = "pacman -S llvm-libs"
    else:
        command = "conda install -c conda-forge libllvm19"
    return f'llvm variants need LLVM {MIN_VERSION} or newer: "{command}", or set {_ENVIRONMENT} to a libLLVM'


def search_patterns() -> list[str]:
    """Globs for libLLVM by platform; environments (conda) come first and win at equal versions."""
    environments = dict.fromkeys([os.environ.get("CONDA_PREFIX") or sys.prefix, sys.prefix])
    if sys.platform == "win32":
        roots = [os.path.join(e, "Library") for e in environments]
        roots.append(os.path.join(os.environ.get("ProgramFiles", r"C:\Program Files"), "LLVM"))
        return [os.path.join(glob.escape(root), "bin", "LLVM-C.dll") for root in roots]
    folders = [os.path.join(glob.escape(e), "lib") for e in environments]
    if sys.platform == "darwin":
        folders += [f"{brew}/opt/llvm*/lib" for brew in ("/opt/homebrew", "/usr/local")]
        return [f"{folder}/libLLVM*.dylib" for folder in folders]
    folders += [glob.escape(f) for f in os.environ.get("LD_LIBRARY_PATH", "").split(":") if f]
    folders += [f"/usr/lib/{platform.machine()}-linux-gnu", "/usr/lib64", "/usr/lib", "/usr/local/lib"]
    folders += ["/usr/lib/llvm-*/lib", "/usr/lib64/llvm*/lib", "/usr/lib/llvm/*/lib64", "/opt/llvm*/lib"]
    return [f"{folder}/libLLVM*.so*" for folder in folders]


def _usable(path: str) -> LLVM | None:
    """The library at ``path`` if it is one for this processor and new enough."""
    if not os.path.isfile(path) or not _same_processor(path):
        return None
    real = os.path.realpath(path)  # "libLLVM.so" is mostly a link to a name with a version
    named = version_of_name(os.path.basename(real)) or version_of_name(os.path.basename(path))
    version = named or ask_version(real)
    return LLVM(path, version) if version and version[0] >= MIN_VERSION else None


def version_of_name(name: str) -> tuple[int, ...] | None:
    """What the name of a file says, as "libLLVM.so.19.1" does; None if it says nothing."""
    match = _FILE_NAME.fullmatch(name)
    digits = match and (match["dash"] or match["end"])
    version = tuple(int(n) for n in digits.split(".") if n) if digits else ()
    return version if version and version[0] > 1 else None  # "libLLVM.so.1" is an ABI number, not LLVM 1


def _same_processor(path: str) -> bool:
    """Whether the ELF header fits this process (/usr/lib may hold 32-bit ones); true without ELF."""
    return not sys.platform.startswith("linux") or _elf_machine(path) == _elf_machine("/proc/self/exe")


def _elf_machine(path: str) -> bytes:
    """Class, byte order and machine of an ELF file; nothing for another file, say a linker script."""
    try:
        with open(path, "rb") as file:
            header = file.read(20)
    except OSError:
        return b""
    return header[4:6] + header[18:20] if header.startswith(b"\x7fELF") else b""


def ask_version(path: str) -> tuple[int, ...] | None:
    """What the library itself says; None if it cannot be loaded or is older than 16 (no LLVMGetVersion)."""
    command = [sys.executable, "-I", "-S", "-c", _ASK_VERSION, path]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
        return tuple(int(n) for n in answer.split())
    except (OSError, ValueError, subprocess.SubprocessError):
        return None
