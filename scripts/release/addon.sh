#!/usr/bin/env bash
# Builds and validates the Blender extension with Blender's own tool, which comes with bpy too.
# Usage: scripts/release/addon.sh PYTHON_OR_BLENDER FOLDER.
set -euo pipefail
cd "$(dirname "$0")/../.."
# Behind what Blender may say itself, such as of colour management.
if scripts=$("$1" -c 'import bpy; print(bpy.utils.system_resource("SCRIPTS"))' 2>/dev/null | tail -n 1); then
    tool=("$1" "$scripts/addons_core/bl_pkg/cli/blender_ext.py")
else
    tool=("$1" --command extension)
fi
mkdir -p "$2"
rm -f "$2"/dogsplat-*.zip
"${tool[@]}" build --source-dir blender_addon --output-dir "$2"
"${tool[@]}" validate "$2"/dogsplat-*.zip
