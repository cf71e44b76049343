#!/usr/bin/env bash
# Builds sdist and wheel into dist/, and uses the wheel in an empty environment and folder.
# Usage: scripts/release/wheel.sh PYTHON...
set -euo pipefail
cd "$(dirname "$0")/../.."
root=$PWD
pip=(-m pip --quiet --disable-pip-version-check)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
unset PYTHONPATH

"$1" -m venv "$work/build"
"$work/build/bin/python" "${pip[@]}" install build
rm -rf dist/mi_dogsplat-*
"$work/build/bin/python" -m build --outdir dist >"$work/log" 2>&1 || { cat "$work/log" >&2; exit 1; } # the wheel from the sdist

for python in "$@"; do
    venv=$work/$(basename "$python")
    "$python" -m venv --clear "$venv"
    "$venv/bin/python" "${pip[@]}" install dist/mi_dogsplat-*.whl
    mkdir -p "$venv/empty"
    cd "$venv/empty"
    "$venv/bin/python" --version
    "$venv/bin/dogsplat" --version
    "$venv/bin/dogsplat" --help >/dev/null
    "$venv/bin/dogsplat" info "$root/scenes/still_life.ply"
    "$venv/bin/dogsplat" render "$root/scenes/still_life.ply" -o model.png
    "$venv/bin/dogsplat" render "$root/scenes/still_life.ply" -o model.exr
    "$venv/bin/python" -W error - "$root/scenes/still_life.xml" <<'PYTHON'
import sys
from pathlib import Path

import mi_dogsplat
import mitsuba as mi

mi.set_variant("llvm_ad_rgb")
image = mi.render(mi.load_file(sys.argv[1])).numpy()
assert image.max() > 0.1
assert Path(mi_dogsplat.__file__).with_name("py.typed").exists()
print(f"rendered {image.shape[1]}x{image.shape[0]} with mi_dogsplat {mi_dogsplat.__version__}")
PYTHON
    "$venv/bin/python" "${pip[@]}" install "$(ls "$root"/dist/mi_dogsplat-*.whl)[train]"
    "$venv/bin/python" -m mi_dogsplat.demo -o demo --steps 20 --target 300 --views 6 --size 32 2>/dev/null
    [ -s demo/demo.png ]
    cd "$root"
done
