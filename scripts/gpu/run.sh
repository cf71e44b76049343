#!/usr/bin/env bash
# Everything that needs a GPU, in one command within 10 minutes: environment, tests, benchmarks, a training, a report.
# Usage: scripts/gpu/run.sh [BUNDLE.tar.xz] [OPTION...]. BUNDLE: packages for a machine without network, from
# "make gpu-bundle"; without one they are installed into .venv-gpu. Options: scripts/gpu/run.sh --help.
# PYTHON names another Python; with a bundle it has to be that which the bundle is for.
set -euo pipefail
began=$(date +%s)
command="scripts/gpu/run.sh $*"
bundle=
if [[ ${1:-} == *.tar.xz ]]; then
    bundle=$(realpath "$1")
    shift
fi
cd "$(dirname "$0")/../.."
python=${PYTHON:-python3}

if [[ " $* " != *" --help "* ]]; then
    "$python" scripts/gpu/machine.py >/dev/null || exit 2
fi
if [ -n "$bundle" ]; then
    site=$PWD/build/gpu/bundle
    "$python" scripts/gpu/unpack.py "$bundle" "$site"
    export PYTHONPATH="$PWD:$site/site${PYTHONPATH:+:$PYTHONPATH}"
    options=(--offline)
    [ ! -d "$site/data" ] || options+=(--bundled-data "$site/data")
else
    scripts/setup/venv.sh "$python" .venv-gpu gpu
    export PATH="$PWD/.venv-gpu/bin:$PATH" # of ninja, which builds gsplat
    python=.venv-gpu/bin/python
    export PYTHONPATH="$PWD${PYTHONPATH:+:$PYTHONPATH}"
    options=()
fi
exec "$python" -m scripts.gpu --began "$began" --command "$command" "${options[@]}" "$@"
