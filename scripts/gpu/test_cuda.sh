#!/usr/bin/env bash
# The tests of engine, tracing, scores, training and pruning in cuda_ad_rgb, without a GPU: on a stand-in for the driver
# of CUDA, which runs on the CPU what Dr.Jit generates.
# Usage: [CUDA_STANDIN=FOLDER] scripts/gpu/test_cuda.sh PYTHON [PYTEST_ARGUMENT...]. CUDA_STANDIN: where the stand-in is,
# by default ../shared/tools/cuda_standin. Says in one line why, and ends well, where it cannot run.
set -euo pipefail
cd "$(dirname "$0")/../.."
python=$1
shift
standin=${CUDA_STANDIN:-../shared/tools/cuda_standin}

skip() {
    echo "no tests of CUDA: $1"
    exit
}
[ -x "$standin/run" ] || skip "there is no stand-in for its driver in $standin; name its folder: make test-cuda CUDA_STANDIN=…"
[ "$(uname -sm)" = "Linux x86_64" ] || skip "the stand-in for its driver needs Linux on x86-64"
for compiler in "${CC:-gcc}" "${CXX:-g++}"; do
    command -v "$compiler" >/dev/null || skip "the stand-in for its driver needs the compiler $compiler (version 12 or newer)"
done

# The stand-in has no OptiX, and whatever loads a Mitsuba scene needs it. Single tests that do are skipped, and say so.
# Left out are
# - most of tests/plugin, captures of scenes, and all else that asks mi.render for a picture;
# - of the engine, test_aovs, test_background and test_derivatives: all of it through mi.render, and what fails in the
#   constructor of an environment emitter ends the process;
# - what computes nothing on a device, such as files, cameras and reports, and what is built of the parts tested here.
tests=(tests/scores tests/training tests/tracing tests/meshing tests/masking)
for name in ellipsoids mitsuba_internals mixed_shape sensor_kinds shape_dog shape_own_axes shape_shifts splat_lamps surfaces; do
    tests+=("tests/plugin/test_$name.py")
done
for file in tests/engine/test_*.py; do
    case $file in
        */test_aovs.py | */test_background.py | */test_derivatives.py) ;;
        *) tests+=("$file") ;;
    esac
done
DOGSPLAT_TEST_VARIANT=cuda_ad_rgb exec "$standin/run" "$python" -m pytest -q -n auto --dist loadfile -rs "${tests[@]}" "$@"
