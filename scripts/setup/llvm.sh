#!/usr/bin/env bash
# Makes sure that Dr.Jit finds an LLVM >= 17 (below that it aborts the process, see mi_dogsplat/support/llvm.py).
# Usage: scripts/setup/llvm.sh PYTHON. Installs nothing when a usable one is there. Exit code 1 and one line otherwise.
set -euo pipefail
cd "$(dirname "$0")/../.."
python=$1

# Run as a plain file: the package itself may not be installed yet.
usable() {
    "$python" - <<'PYTHON'
import runpy, sys
llvm = runpy.run_path("mi_dogsplat/support/llvm.py", run_name="llvm")
found = llvm["find_llvm"]()
print(f"LLVM: {found.path}" if found else llvm["explain"]())
sys.exit(found is None)
PYTHON
}

if usable >/dev/null; then
    usable
    exit
fi

as_root=()
if [ "$(id -u)" != 0 ]; then
    as_root=(sudo -n) # never ask for a password in the middle of a build
fi
if command -v apt-get >/dev/null && "${as_root[@]}" true 2>/dev/null; then
    echo "LLVM: no usable one found, installing from apt"
    "${as_root[@]}" apt-get update -qq || true # an unreachable extra source must not stop us
    for version in 19 22 21 20 18 17; do
        if apt-cache show "libllvm$version" >/dev/null 2>&1; then
            "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends \
                "libllvm$version" >/dev/null && break
        fi
    done
fi
usable
