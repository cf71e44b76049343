"""LLVM: the newest usable library is found by name; an old one is an error, not an aborted process."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import drjit
import pytest
from mi_dogsplat.support import llvm

ROOT = Path(__file__).parents[2]
OLD = next(Path("/usr/lib").glob("*/libLLVM-1[456].so*"), None)
linux_only = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="needs Linux: it makes ELF files"
)
needs_llvm = pytest.mark.skipif(llvm.find_llvm() is None, reason=llvm.explain())
needs_old = pytest.mark.skipif(OLD is None, reason='needs an unusable LLVM: "apt-get install libllvm15"')


def library(folder: Path, name: str) -> str:
    """A file that looks like a shared library for this processor; its content cannot be loaded."""
    path = folder / name
    path.write_bytes(Path("/proc/self/exe").read_bytes()[:64])
    return str(path)


def run_python(code: str, **environment: str) -> subprocess.CompletedProcess:
    env = os.environ | {"PYTHONPATH": str(ROOT)} | environment
    return subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, timeout=300)


@pytest.fixture
def only_here(tmp_path, monkeypatch) -> Path:
    """The only folder that is searched."""
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(llvm, "search_patterns", lambda: [f"{tmp_path}/libLLVM*.so*"])
    return tmp_path


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("libLLVM-15.so.1", (15,)),
        ("libLLVM-14.0.6.so.1", (14, 0, 6)),
        ("libLLVM.so.19.1", (19, 1)),
        ("libLLVM-19.so", (19,)),
        ("libLLVM-19.dylib", (19,)),
        ("libLLVM.so", None),
        ("libLLVM.so.1", None),
        ("LLVM-C.dll", None),
        ("libLLVM-17-rust-1.78.0-stable.so", None),
        ("libLLVM-15jl.so", None),
    ],
)
def test_the_version_is_taken_from_the_file_name(name, version):
    assert llvm.version_of_name(name) == version


@linux_only
def test_the_newest_library_for_this_processor_wins(only_here):
    names = ["libLLVM-14.0.6.so.1", "libLLVM-18.so.1", "libLLVM.so.22.1", "libLLVM-9.so", "libLLVM-20.so"]
    for name in [*names, "libLLVM-98-rust-1.80.so"]:
        library(only_here, name)
    other = bytearray(Path("/proc/self/exe").read_bytes()[:64])
    other[4] ^= 3  # 32 instead of 64 bits
    (only_here / "libLLVM-97.so").write_bytes(other)
    (only_here / "libLLVM-96.so").write_text("INPUT(libLLVM.so.96)")
    (only_here / "libLLVM-95.so").mkdir()
    assert llvm.find_llvm() == llvm.LLVM(str(only_here / "libLLVM.so.22.1"), (22, 1))


@linux_only
def test_a_link_has_the_version_of_the_file_behind_it(only_here):
    library(only_here, "libLLVM.so.19.1")
    os.symlink("libLLVM.so.19.1", only_here / "libLLVM.so")
    os.symlink("libLLVM.so.19.1", only_here / "libLLVM-99.so")
    found = llvm.find_llvm()
    assert found and found.version == (19, 1)


@linux_only
def test_a_usable_library_that_the_user_named_is_kept(only_here, monkeypatch):
    library(only_here, "libLLVM.so.22.1")
    named = library(only_here, "libLLVM-18.so")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", named)
    llvm.choose_llvm()
    assert os.environ["DRJIT_LIBLLVM_PATH"] == named


@linux_only
@pytest.mark.parametrize("named", ["", "/no/such/libLLVM-19.so", "{folder}", "{folder}/libLLVM-15.so"])
def test_an_unusable_library_that_the_user_named_is_replaced(only_here, monkeypatch, named):
    best = library(only_here, "libLLVM.so.22.1")
    library(only_here, "libLLVM-15.so")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", named.format(folder=only_here))
    llvm.choose_llvm()
    assert os.environ["DRJIT_LIBLLVM_PATH"] == best


@linux_only
def test_without_a_usable_library_nothing_is_set_and_nothing_fails(only_here):
    library(only_here, "libLLVM-15.so")
    shutil.copy(Path(drjit.__file__).parent / "libnanothread.so", only_here / "libLLVM.so")  # loads, but is no LLVM
    library(only_here, "libLLVM.so.1")  # does not load
    llvm.choose_llvm()
    assert llvm.find_llvm() is None and "DRJIT_LIBLLVM_PATH" not in os.environ


def test_the_way_to_a_usable_llvm_is_one_line():
    assert "\n" not in llvm.explain() and "DRJIT_LIBLLVM_PATH" in llvm.explain()


@needs_llvm
def test_a_library_that_is_asked_says_the_version_of_its_name():
    found = llvm.find_llvm()
    assert found
    answer = llvm.ask_version(found.path)
    assert answer and answer[0] == found.version[0]


@needs_llvm
@needs_old
def test_choosing_before_mitsuba_is_imported_saves_the_process_from_an_old_llvm():
    code = """
from mi_dogsplat.support import llvm
llvm.choose_llvm()
import drjit as dr, mitsuba as mi
mi.set_variant("llvm_ad_rgb")
llvm.check_loaded_llvm()
x = dr.arange(mi.Float, 3)
print(dr.detail.llvm_version()[0] >= 17, dr.minimum(x, mi.Float(1)))
"""
    done = run_python(code, DRJIT_LIBLLVM_PATH=str(OLD))
    assert done.stdout.split(maxsplit=1) == ["True", "[0, 1, 1]\n"], done.stderr


@needs_old
def test_an_old_llvm_that_is_already_loaded_is_one_clear_error():
    code = """
import mitsuba as mi
from mi_dogsplat.support import llvm
try:
    mi.set_variant("llvm_ad_rgb")
except RuntimeError as error:
    print(error)
mi.set_variant("scalar_rgb")
llvm.check_loaded_llvm()
"""
    done = run_python(code, DRJIT_LIBLLVM_PATH=str(OLD))
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    assert line.startswith("Dr.Jit has loaded LLVM 1") and "aborts on float min and max; " in line


def stub(folder: Path, name: str, script: str):
    path = folder / name
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


def run_setup(folder: Path) -> subprocess.CompletedProcess:
    """scripts/setup/llvm.sh with a stand-in for Python, which finds what a stand-in for apt-get installed."""
    stub(
        folder,
        "python",
        f"cat > /dev/null; echo python >> {folder}/log; test -e {folder}/installed && echo found",
    )
    env = os.environ | {"PATH": f"{folder}:{os.environ['PATH']}"}
    command = [str(ROOT / "scripts" / "setup" / "llvm.sh"), str(folder / "python")]
    return subprocess.run(command, env=env, capture_output=True, text=True, timeout=300)


@linux_only
def test_setup_installs_an_llvm_from_apt_once(tmp_path):
    stub(tmp_path, "id", "echo 0")
    log, installed = tmp_path / "log", tmp_path / "installed"
    only_18 = f'case "$*" in update*) ;; *libllvm18) echo installed >> {log}; touch {installed} ;; *) exit 100 ;; esac'
    stub(tmp_path, "apt-get", only_18)  # as on an older Ubuntu
    assert run_setup(tmp_path).returncode == 0
    assert run_setup(tmp_path).returncode == 0
    assert log.read_text().splitlines().count("installed") == 1


@linux_only
def test_setup_that_cannot_install_fails_without_asking_for_a_password(tmp_path):
    stub(tmp_path, "id", "echo 1000")
    stub(tmp_path, "sudo", "exit 1")
    stub(tmp_path, "apt-get", f"echo apt-get >> {tmp_path}/log")
    assert run_setup(tmp_path).returncode == 1
    assert "apt-get" not in (tmp_path / "log").read_text()
