"""Unpacks a bundle of packages, once: ``python scripts/gpu/unpack.py BUNDLE.tar.xz FOLDER``, by the library alone.

Exit status 2, and one line, where the bundle is for another Python or is none.
"""

from __future__ import annotations

import json
import lzma
import shutil
import sys
import tarfile
from pathlib import Path

MANIFEST = "bundle.json"


def main(bundle: Path, folder: Path) -> int:
    stamp = folder / "unpacked"
    mark = f"{bundle.stat().st_size} {bundle.stat().st_mtime_ns}" if bundle.is_file() else ""
    if mark and stamp.is_file() and stamp.read_text() == mark:
        return 0
    shutil.rmtree(folder, ignore_errors=True)
    try:
        with tarfile.open(bundle, "r:xz") as archive:
            if hasattr(tarfile, "data_filter"):  # not in every release of 3.10 and 3.11
                archive.extraction_filter = tarfile.data_filter
            archive.extractall(folder)
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, EOFError, tarfile.TarError, lzma.LZMAError, ValueError) as error:
        print(f"{bundle}: cannot be unpacked ({error}); make it again: make gpu-bundle", file=sys.stderr)
        return 2
    if manifest["python"] != (version := "{}.{}".format(*sys.version_info)):
        problem = f"is for Python {manifest['python']}, and this is {version}"
        print(f"{bundle}: {problem}; name it: PYTHON=python{manifest['python']}", file=sys.stderr)
        return 2
    stamp.write_text(mark)
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
