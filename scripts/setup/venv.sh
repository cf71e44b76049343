#!/usr/bin/env bash
# Installs the package with some of its extras into a virtual environment.
# Usage: scripts/setup/venv.sh PYTHON VENV EXTRAS.
set -euo pipefail
cd "$(dirname "$0")/../.."
python=$1
venv=$2
extras=$3

if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 10))'; then
    echo "$python is missing or older than 3.10; name another one: make PYTHON=python3.12" >&2
    exit 1
fi
if ! "$venv/bin/python" -m pip --version >/dev/null 2>&1; then
    # Debian and Ubuntu ship Python without the part that makes environments.
    if ! "$python" -c 'import ensurepip' 2>/dev/null; then
        package=python3-venv
        as_root=()
        if [ "$(id -u)" != 0 ]; then
            as_root=(sudo -n) # never ask for a password in the middle of a build
        fi
        if ! command -v apt-get >/dev/null || ! "${as_root[@]}" true 2>/dev/null; then
            echo "$python cannot make virtual environments: apt-get install $package" >&2
            exit 1
        fi
        "${as_root[@]}" apt-get update -qq || true # an unreachable extra source must not stop us
        "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "$package" >/dev/null
    fi
    "$python" -m venv --clear "$venv"
fi
said=$(mktemp)
trap 'rm -f "$said"' EXIT
if ! "$venv/bin/python" -m pip install -q --disable-pip-version-check -e ".[$extras]" 2>"$said"; then
    # Without a network pip says in many lines that there is no such package.
    if grep -qE 'connection broken|Max retries exceeded|timed out|NameResolution' "$said"; then
        echo "the package index cannot be reached, and set-up installs from it: connect to the network, or name a mirror: PIP_INDEX_URL=…" >&2
    else
        cat "$said" >&2
    fi
    exit 1
fi
