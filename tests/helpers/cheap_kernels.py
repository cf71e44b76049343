"""Kernels of tests are compiled without LLVM's passes over Dr.Jit's code, which are more than half of the work.

Most kernels of tests run a few times on a few hundred primitives, and compiling them took longer than all else that
the tests do. Dr.Jit's code is the same, and LLVM makes machine code of it as always. So are the bits of all numbers:
no pass may change how an operation rounds (``tests/engine/test_cheap_kernels.py``).

Dr.Jit takes the functions of LLVM from a library that is named to it. Here it is told of one whose passes do nothing,
and which is linked to LLVM for all else. That needs Linux and a C compiler. ``DOGSPLAT_TEST_OPTIMISED=1`` compiles
kernels as for users.

Importing this does it, for this process and all that it starts. It comes before Dr.Jit, which asks for the library and
the folder of its kernels once.
"""

import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

SOURCE = "void *LLVMRunPasses(void *module, const char *passes, void *machine, void *options) { return 0; }\n"
FOLDER = "of_tests"  # of kernels and library, below that of Dr.Jit: users are not to get these kernels
LIBRARY, KERNELS = "DRJIT_LIBLLVM_PATH", "DRJIT_CACHE_DIR"


def environment_of_users() -> dict[str, str]:
    """Of a process that compiles as for users."""
    return {name: value for name, value in os.environ.items() if name not in (LIBRARY, KERNELS)}


def _chosen_llvm() -> Path | None:
    """The one that the package chooses; with all of the package, Dr.Jit would load it."""
    file = Path(__file__).parents[2] / "mi_dogsplat" / "support" / "llvm.py"
    spec = importlib.util.spec_from_file_location("llvm_alone", file)
    assert spec is not None and spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = module.find_llvm()
    return None if found is None else Path(found.path).resolve()


def _library(llvm: Path, folder: Path) -> Path:
    """It is built once for each LLVM."""
    digest = hashlib.sha256(f"{llvm}\n{SOURCE}".encode()).hexdigest()[:8]
    path = folder / digest / llvm.name  # whose name tells the version
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as part:
            made = Path(part) / path.name
            command = ["cc", "-shared", "-fPIC", "-o", str(made), "-Wl,--no-as-needed", str(llvm), "-x", "c", "-"]
            subprocess.run(command, input=SOURCE, text=True, check=True, capture_output=True)
            made.replace(path)
    return path


def _compile_cheaply() -> bool:
    """Whether all that is compiled from here on is compiled so."""
    folder = Path(os.environ.get(KERNELS) or Path.home() / ".drjit")
    if folder.name == FOLDER:  # inherited
        return True
    on_llvm = os.environ.get("DOGSPLAT_TEST_VARIANT", "llvm").startswith("llvm")
    if not on_llvm or os.environ.get("DOGSPLAT_TEST_OPTIMISED"):
        return False
    llvm = _chosen_llvm()
    if llvm is None or not sys.platform.startswith("linux") or shutil.which("cc") is None:
        return False
    folder /= FOLDER
    try:
        library = _library(llvm, folder)
    except (OSError, subprocess.CalledProcessError):  # a home that nobody may write to, a compiler without its linker
        return False
    os.environ |= {LIBRARY: str(library), KERNELS: str(folder)}
    return True


CHEAP = _compile_cheaply()
