#!/usr/bin/env bash
# Builds and validates the Blender extension with Blender's own tool, which comes with bpy.
# Usage: scripts/build_addon.sh PYTHON FOLDER.
set -euo pipefail
cd "$(dirname "$0")/.."
scripts=$("$1" -c 'import bpy; print(bpy.utils.system_resource("SCRIPTS"))')
tool=$scripts/addons_core/bl_pkg/cli/blender_ext.py
mkdir -p "$2"
rm -f "$2"/dogsplat-*.zip
"$1" "$tool" build --source-dir blender_addon --output-dir "$2"
"$1" "$tool" validate "$2"/dogsplat-*.zip
