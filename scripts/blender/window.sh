#!/usr/bin/env bash
# Shows the add-on in Blender's window, on a display that exists in memory only, and takes pictures of it.
# Usage: scripts/blender/window.sh MODEL.ply RUN OUT [PICTURE …]. Where scripts/blender/chroot.sh has made a Debian:
#     chroot /opt/blender_sid "$PWD"/scripts/blender/window.sh …
# Needs blender, xvfb, openbox, xdotool, imagemagick; DOGSPLAT_COMMAND names the command dogsplat for the final frame.
set -euo pipefail
cd "$(dirname "$0")/../.."
out=$3
mkdir -p "$out"
export HOME=$out/home BLENDER_USER_RESOURCES=$out/blender LIBGL_ALWAYS_SOFTWARE=1
mkdir -p "$HOME"
scripts/release/addon.sh blender "$out"
blender --command extension install-file -r user_default -e "$out"/dogsplat-*.zip
blender --background --python-exit-code 1 --python-expr \
    'import bpy; bpy.context.preferences.view.show_splash = False; bpy.ops.wm.save_userpref()'
xvfb-run -a -s "-screen 0 1600x1000x24" sh -c 'openbox & exec blender "$@"' blender \
    --window-geometry 0 0 1600 1000 --python-exit-code 1 --python scripts/blender/window.py -- "$@"
