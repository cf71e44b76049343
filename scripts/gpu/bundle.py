"""Packs what a machine without network needs to run ``scripts/gpu``: packages for Python 3.12 on Linux, and data.

``python -m scripts.gpu.bundle OUT.tar.xz``. Wheels are unpacked, what no step needs is left out (``wanted``), and all
is packed as one archive, smaller than the wheels: a repository without its ``docs/pictures`` fits into a transfer of
64 MiB together with it.
"""

from __future__ import annotations

import argparse
import io
import json
import lzma
import re
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

from .steps import DEMO, DEMO_SIZE, ROOT
from .unpack import MANIFEST

PYTHON = "3.12"
LIMIT = 52 * 2**20  # bytes; the repository takes 10 MiB, its docs/pictures 13 more, which nothing here needs
VARIANTS = ("scalar_rgb", "llvm_ad_rgb", "llvm_ad_mono", "cuda_ad_rgb")  # that the tests use
# gsplat's own, and what it imports but for PyTorch, which the machine has or has not
ALSO = ("gsplat", "jaxtyping", "wadler-lindig", "rich", "markdown-it-py", "mdurl")
PLATFORMS = [f"manylinux_2_{minor}_x86_64" for minor in (28, 27, 17)] + ["manylinux2014_x86_64"]
FILTERS = [{"id": lzma.FILTER_X86}, {"id": lzma.FILTER_LZMA2, "preset": 6, "dict_size": 2**26}]
# Plugins of Mitsuba that no step names.
UNUSED = (
    "bsplinecurve catmullrom circular hair irradiancemeter linearcurve measured measured_polarized polarizer pplastic"
    " principledthin retarder sdfgrid sggx specfilm stokes sunsky tabphase timed_sunsky volpathmis"
).split()
# Headers, stubs, tests, manuals, spectra, variants that are not in VARIANTS, parts of SciPy of which nothing is
# imported, and a format of pictures that nobody reads.
LEFT_OUT = re.compile(
    r"(.*/)?tests?/"
    r"|.*\.pyi$"
    r"|gsplat/cuda/csrc/third_party/glm/(doc|util)/"
    r"|(mitsuba|drjit)/(include|cmake|stubs)/"
    r"|mitsuba/data/srgb\.coeff$"
    rf"|mitsuba/(?!({'|'.join(VARIANTS)})\.)(scalar|llvm|cuda)_\w+\."
    rf"|mitsuba/plugins/({'|'.join(UNUSED)})\."
    r"|PIL/_avif\.|pillow\.libs/libavif"
    r"|scipy/(cluster|datasets|differentiate|fft|fftpack|integrate|interpolate|io|odr|optimize|signal|stats)/"
)


def main(argv: list[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m scripts.gpu.bundle", description=__doc__)
    parser.add_argument("out", type=Path, metavar="OUT.tar.xz")
    parser.add_argument("--wheels", type=Path, help="a folder of wheels (default: fetch them)")
    parser.add_argument("--data", type=Path, help="a data set to train on (default: capture that of the demo)")
    args = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        wheels = args.wheels or _fetch(Path(folder))
        data = args.data or _capture(ROOT / "build" / "gpu" / "demo_data")
        args.out.parent.mkdir(parents=True, exist_ok=True)
        pack(sorted(wheels.glob("*.whl")), data, args.out)
    size = args.out.stat().st_size
    print(f"{args.out}: {size / 2**20:.1f} MiB")
    if size > LIMIT:
        problem = f"is larger than {LIMIT / 2**20:.0f} MiB"
        print(f"{args.out}: {problem}; leave out more in scripts/gpu/bundle.py", file=sys.stderr)
        return 1
    return 0


def _fetch(folder: Path) -> Path:
    pip = [sys.executable, "-m", "pip", "download", "-q", "--disable-pip-version-check", "--only-binary=:all:"]
    pip += ["--python-version", PYTHON, "--implementation", "cp", "-d", str(folder)]
    pip += [word for platform in PLATFORMS for word in ("--platform", platform)]
    subprocess.run([*pip, f"{ROOT}[gpu]"], check=True)
    subprocess.run([*pip, "--no-deps", *ALSO], check=True)
    return folder


def _capture(folder: Path) -> Path:
    """The data of ``make demo``; what is complete of it is kept."""
    command = [sys.executable, "-m", "mi_dogsplat", "capture", *DEMO, *DEMO_SIZE, "-o", str(folder)]
    subprocess.run(command, check=True)
    return folder


def pack(wheels: list[Path], data: Path | None, out: Path) -> None:
    """Write the archive: ``bundle.json``, ``site/`` with the packages, ``data/``."""
    manifest = {"python": PYTHON, "variants": VARIANTS, "wheels": [wheel.name for wheel in wheels]}
    with lzma.open(out, "wb", filters=FILTERS) as file, tarfile.open(fileobj=file, mode="w") as archive:
        _add(archive, MANIFEST, json.dumps(manifest, indent=1).encode())
        for wheel in wheels:
            for name, content in contents(wheel):
                _add(archive, f"site/{name}", content)
        for path in sorted(data.rglob("*")) if data else ():
            if path.is_file():
                _add(archive, f"data/{path.relative_to(data)}", path.read_bytes())


def contents(wheel: Path) -> Iterator[tuple[str, bytes]]:
    """Names and contents of the files of a wheel that are wanted."""
    with zipfile.ZipFile(wheel) as archive:
        for info in archive.infolist():
            if not info.is_dir() and wanted(info.filename):
                yield info.filename, archive.read(info)


def wanted(name: str) -> bool:
    """Whether a step may need a file of a package; programs and data beside the packages are none."""
    return LEFT_OUT.match(name) is None and ".data/" not in name


def _add(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    info = tarfile.TarInfo(name)
    info.size, info.mode = len(content), 0o755 if name.endswith(".so") else 0o644
    archive.addfile(info, io.BytesIO(content))


if __name__ == "__main__":
    sys.exit(main())
