#!/usr/bin/env bash
# Frames per second of viewports that our engine draws, on one core, two, and all: the tables in docs/blender.md.
# Usage: scripts/blender_rendered.sh MODEL.ply COMMAND [CHROOT]: COMMAND starts the package, as "$PWD/.venv/bin/python
# -m mi_dogsplat"; CHROOT is a folder of scripts/blender_chroot.sh, as root, for redraws in Blender's window.
set -euo pipefail
cd "$(dirname "$0")/.."
model=$(realpath "$1")
command=$2
chroot=${3:-}
last=$(($(nproc) - 1))
uptime
for cores in 0 0,1 "0-$last"; do
    echo "== cores $cores"
    PYTHONPATH=$PWD taskset -c "$cores" .venv-blender/bin/python scripts/blender_rendered.py "$model" "$command" |
        grep -v ^Info
    [ -z "$chroot" ] || PYTHONPATH=$PWD LIBGL_ALWAYS_SOFTWARE=1 taskset -c "$cores" chroot "$chroot" sh -c 'cd "$0"; exec "$@"' \
        "$PWD" xvfb-run -a -s "-screen 0 1600x1000x24" blender --window-geometry 0 0 1600 1000 --factory-startup \
        --python scripts/blender_rendered.py -- "$model" "$command" | grep -v ^Info
done
uptime
