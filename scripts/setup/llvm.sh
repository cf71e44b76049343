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

echo "LLVM: no usable one found, trying apt"
for version in 19 22 21 20 18 17; do
    scripts/setup/apt_install.sh "libllvm$version" 2>/dev/null && break
done
usable
