#!/usr/bin/env bash
# Installs the package with all extras into a virtual environment. Usage: scripts/setup_venv.sh PYTHON VENV.
set -euo pipefail
cd "$(dirname "$0")/.."
python=$1
venv=$2

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
"$venv/bin/python" -m pip install -q --disable-pip-version-check -e '.[train,export,view,dev]'
