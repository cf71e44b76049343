#!/usr/bin/env bash
# Installs packages of Debian or Ubuntu, as root or by sudo without a password.
# Usage: scripts/setup/apt_install.sh PACKAGE...; exit code 1 where that cannot be done, with what apt said.
set -euo pipefail

as_root=()
if [ "$(id -u)" != 0 ]; then
    as_root=(sudo -n) # never ask for a password in the middle of a build
fi
if ! command -v apt-get >/dev/null || ! "${as_root[@]}" true 2>/dev/null; then
    exit 1
fi
exec 9<"$0"
flock 9 # Blender and the package are set up at the same time, and apt refuses the second of two

said=$(mktemp)
trap 'rm -f "$said"' EXIT
"${as_root[@]}" apt-get update -qq >/dev/null 2>&1 || true # an unreachable extra source must not stop us
if ! "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "$@" >"$said" 2>&1; then
    cat "$said" >&2
    exit 1
fi
