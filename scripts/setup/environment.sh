#!/usr/bin/env bash
# Makes an empty virtual environment, unless there is one.
# Usage: scripts/setup/environment.sh PYTHON VENV. One line and exit code 1 where that cannot be done.
set -euo pipefail
cd "$(dirname "$0")/../.."
python=$1
venv=$2

if "$venv/bin/python" -m pip --version >/dev/null 2>&1; then
    exit
fi
# Debian and Ubuntu ship Python without the part that makes environments.
if ! "$python" -c 'import ensurepip' 2>/dev/null && ! scripts/setup/apt_install.sh python3-venv; then
    echo "$python cannot make virtual environments: apt-get install python3-venv" >&2
    exit 1
fi
"$python" -m venv --clear "$venv"
