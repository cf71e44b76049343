"""Makes gsplat ready, which compiles its kernels when it is first used: ``python -m scripts.gpu.gsplat [--install]``.

Exit status 2, and one line that says why, where it cannot be had.
"""

import argparse
import importlib.util
import subprocess
import sys

MISSING = 2


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--install", action="store_true", help="install what is missing from the package index")
    args = parser.parse_args()
    missing = [name for name in ("torch", "gsplat") if importlib.util.find_spec(name) is None]
    if missing and args.install:
        command = [sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", *missing, "ninja"]
        if subprocess.run(command).returncode == 0:
            missing = []
    if missing:
        return _without(f"there is no package {' and no '.join(missing)}")
    import torch

    if not torch.cuda.is_available():
        return _without("PyTorch sees no GPU")
    try:
        from gsplat.cuda._backend import _C
    except Exception as error:  # whatever stops a compiler
        return _without(str(error).splitlines()[0] if str(error) else type(error).__name__)
    if _C is None:
        return _without("it was built without CUDA, and there is no compiler nvcc")
    from importlib.metadata import version

    print(f"gsplat {version('gsplat')} is ready, with PyTorch {torch.__version__}")
    return 0


def _without(reason: str) -> int:
    print(f"gsplat is missing: {reason}")
    return MISSING


if __name__ == "__main__":
    sys.exit(main())
