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
scripts/setup/environment.sh "$python" "$venv"
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
