#!/usr/bin/env bash
# Installs Blender as a Python module, with the package, into an environment of its own (bpy wants an older NumPy).
# Usage: scripts/setup/blender.sh PYTHON VENV [VERSION]: VERSION as 4.2; without one the newest for Python 3.11. Says in
# one line why, and fails, where that is not possible.
set -euo pipefail
cd "$(dirname "$0")/../.."
venv=$2
version=${3:-}
minor=11 # of Python, for which the wheels are; from 5.1 on they are for another
case $version in 5.[1-9]*) minor=13 ;; esac

pyenv=("${PYENV_ROOT:-$HOME/.pyenv}"/versions/3.$minor.*/bin/python) # those that "pyenv global" does not name
python=$(for p in "$1" "python3.$minor" "${pyenv[@]}"; do
    "$p" -c "import sys; sys.exit(sys.version_info[:2] != (3, $minor))" 2>/dev/null && echo "$p" && break
done) || {
    echo "no Blender $version: its wheels need Python 3.$minor, and there is none; name it: make blender PYTHON=…" >&2
    exit 1
}

scripts/setup/environment.sh "$python" "$venv"
if ! "$venv/bin/python" -m pip install -q --disable-pip-version-check -e '.[blender]' ${version:+"bpy==$version.*"}; then
    echo "no Blender: the wheel bpy (about 400 MB) cannot be had; the tests of the add-on are skipped" >&2
    exit 1
fi
# Blender links to libraries of a desktop; EEVEE renders without a screen through EGL and Mesa.
libraries=(libegl1 libgl1 libgl1-mesa-dri libice6 libsm6 libx11-6 libxext6 libxfixes3 libxi6 libxkbcommon0 libxxf86vm1)
if ! "$venv/bin/python" -c 'import bpy, ctypes; ctypes.CDLL("libEGL.so.1")' >/dev/null 2>&1; then
    if ! scripts/setup/apt_install.sh "${libraries[@]}" 2>/dev/null; then
        echo "no Blender: libraries are missing: apt-get install ${libraries[*]}" >&2
        exit 1
    fi
    "$venv/bin/python" -c 'import bpy'
fi
