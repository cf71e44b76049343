"""The machine's GPU, driver and processor, by the standard library alone: it is asked before anything is installed."""

from __future__ import annotations

import ctypes
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

DRIVER, OPTIX = "libcuda.so.1", "libnvoptix.so.1"
FOLDERS = tuple(map(Path, ("/usr/local/nvidia/lib64", "/usr/lib/x86_64-linux-gnu", "/usr/lib64", "/usr/lib/wsl/lib")))


def main() -> int:
    """``python scripts/gpu/machine.py``: exit status 0 and the GPU's name, or 2 and one line that there is none."""
    found = gpu()
    if found is None:
        print("there is no GPU that CUDA can use here: no driver is found, or it shows no device", file=sys.stderr)
        return 2
    print(found["gpu"])
    return 0


def describe() -> dict[str, str | int]:
    """What a figure depends on: GPU, its memory in MiB, driver, processor, cores, system. Needs a GPU."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    system = f"{platform.system()} {platform.release()}"
    return (gpu() or {}) | {"processor": _processor(), "cores": cores, "system": system}


def gpu() -> dict[str, str | int] | None:
    """Name, memory in MiB and driver of the first device; None where there is none."""
    path = os.environ.get("DRJIT_LIBCUDA_PATH") or _found(DRIVER)
    try:
        cuda = ctypes.CDLL(path or DRIVER)
    except OSError:
        return None
    count, device, version = ctypes.c_int(), ctypes.c_int(), ctypes.c_int()
    name, size = ctypes.create_string_buffer(256), ctypes.c_size_t()
    if cuda.cuInit(0) or cuda.cuDeviceGetCount(ctypes.byref(count)) or not count.value:
        return None
    cuda.cuDeviceGet(ctypes.byref(device), 0)
    cuda.cuDeviceGetName(name, len(name), device)
    cuda.cuDeviceTotalMem_v2(ctypes.byref(size), device)
    cuda.cuDriverGetVersion(ctypes.byref(version))
    supports = f"CUDA {version.value // 1000}.{version.value % 1000 // 10}"
    driver = "" if "DRJIT_LIBCUDA_PATH" in os.environ else _driver_version()
    return {
        "gpu": name.value.decode(),
        "gpu_memory_mb": size.value // 2**20,
        "driver": f"{driver} ({supports})" if driver else supports,
    }


def library_environment() -> dict[str, str]:
    """``LD_LIBRARY_PATH`` with the folders that hold the driver or OptiX where the loader does not look by itself."""
    folders = dict.fromkeys(str(Path(path).parent) for path in (_found(DRIVER), _found(OPTIX)) if path)
    before = os.environ.get("LD_LIBRARY_PATH")
    return {"LD_LIBRARY_PATH": ":".join([*([before] if before else []), *folders])} if folders else {}


def _found(library: str) -> str | None:
    """Path of a library that the loader does not find; None where it does, or where there is none."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return next((str(folder / library) for folder in FOLDERS if (folder / library).exists()), None)
    return None


def _driver_version() -> str:
    """As nvidia-smi has it; empty where it is not there."""
    command = ["nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=30)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.splitlines()[0].strip() if done.returncode == 0 and done.stdout.strip() else ""


def _processor() -> str:
    try:
        name = re.search(r"^model name\s*: (.+)$", Path("/proc/cpuinfo").read_text(), re.M)
    except OSError:
        name = None
    return name[1] if name else platform.processor() or platform.machine()


if __name__ == "__main__":
    sys.exit(main())
