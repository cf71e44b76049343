#!/usr/bin/env bash
# Frames per second of viewports that our engine draws: the tables in docs/blender_details.md.
# Usage: [CORES="0 0,1"] scripts/blender/rendered.sh MODEL.ply COMMAND [CHROOT [PICTURE.png]]: COMMAND starts the
# package, as "$PWD/.venv/bin/python -m mi_dogsplat". CHROOT is a folder of scripts/blender/chroot.sh, as root, for
# redraws in Blender's window. CORES are tried one after the other: one core, two, and all, unless they say otherwise.
set -euo pipefail
cd "$(dirname "$0")/../.."
model=$(realpath "$1")
command=$2
chroot=${3:-}
picture=${4:-}
uptime
for cores in ${CORES:-0 0,1 0-$(($(nproc) - 1))}; do
    echo "== cores $cores"
    PYTHONPATH=$PWD taskset -c "$cores" .venv-blender/bin/python scripts/blender/rendered.py "$model" "$command" |
        grep -v ^Info
    if [ -n "$chroot" ]; then
        window=(xvfb-run -a -s "-screen 0 1600x1000x24" blender --window-geometry 0 0 1600 1000 --factory-startup)
        PYTHONPATH=$PWD LIBGL_ALWAYS_SOFTWARE=1 taskset -c "$cores" chroot "$chroot" sh -c 'cd "$0" && exec "$@"' "$PWD" \
            "${window[@]}" --python scripts/blender/rendered.py -- "$model" "$command" ${picture:+"$picture"} |
            grep -v ^Info
    fi
done
uptime
