"""Machine code of a Dr.Jit kernel on AVX-512: made from its LLVM IR, and counted by what its instructions are for.

Bounds come from the pipes of a Zen 5, found by timing pairs of instructions in a loop (512 bits each): multiplications
run on two pipes, additions, minima, shifts and conversions on the two others, comparisons and lane-crossing moves on
one of each, logic, blends and unpacking on all four; two loads and one store a cycle, eight instructions decoded.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path

import drjit as dr

PIPES = {"multiply": {0, 1}, "add": {2, 3}, "compare": {1, 2}, "any": {0, 1, 2, 3}}  # of the vector unit
PER_CYCLE = {"load": 2, "store": 1, "to scalar": 2, "decode": 8}
GATHER_LOADS = 16
ITERATIONS = 20  # that llvm-mca simulates

# what an instruction is for, the pipe it needs, and how it is recognised: the first match counts
ROW = "fetch of rows"
KINDS = (
    ("to the stack: state and spills", "", r"v?k?mov\w* \w+ ptr \[r[sb]p"),
    ("from the stack: state and spills", "", r"v?k?mov\w* [^,]+, \w+ ptr \[r[sb]p"),
    (ROW, "to scalar", r"vmovq r|vpextr"),
    (ROW, "compare", r"vinsert|vextract|vpmov[sz]x|vshuf[fi]"),
    (ROW, "add", r"vpsllq"),
    (ROW, "any", r"vpaddq|vp?unpck|vperm|vshuf"),
    (ROW, "gather", r"vp?gather"),
    (ROW, "", r"vmov\w+ [xy]mm"),
    ("multiplications", "multiply", r"vmul|vfn?m"),
    ("comparisons", "compare", r"vp?cmp|vp?test|vpmov\w2m"),
    ("additions, minima, shifts, conversions", "add", r"v(add|sub|min|max|psll|psrl|psra|rndscale|cvt)"),
    ("masked moves, blends", "any", r"vp?blend|vmov\w+ zmm\d+ \{"),
    ("logic, integer additions", "any", r"vp?(and|or|xor|tern|add|sub)"),
    ("moves between registers", "", r"vmov\w+ zmm\d+, zmm"),
    ("constants", "", r"vp?broadcast|vmov"),
    ("scalar instructions and masks", "", r""),
)


def compiled(ir: str, folder: Path) -> str:
    """Assembly of a kernel, made as Dr.Jit makes it: passes of -O2 without unrolling and vectorisation, then -O3."""
    (folder / "kernel.ll").write_text(ir)
    passes = "-passes=default<O2>", "-unroll-runtime=false", "-vectorize-loops=false", "-vectorize-slp=false"
    tool("opt", *passes, "-S", "kernel.ll", "-o", "kernel.opt.ll", folder=folder)
    code = "-O3", "-relocation-model=pic", "--x86-asm-syntax=intel"
    tool("llc", *code, "kernel.opt.ll", "-o", "kernel.s", folder=folder)
    return (folder / "kernel.s").read_text()


def tool(name: str, *flags: str, folder: Path) -> str:
    """Run a tool of the LLVM version that Dr.Jit uses; its output."""
    version = dr.detail.llvm_version()[0]
    path = shutil.which(f"{name}-{version}")
    if path is None:
        raise SystemExit(f'needs {name} of LLVM {version}: "apt-get install llvm-{version}"')
    return subprocess.run([path, *flags], cwd=folder, capture_output=True, text=True, check=True).stdout


def loop_of(assembly: str) -> list[str]:
    """Instructions of the walk: the inner of the two loops, which llc marks as being of depth 2."""
    instructions, depth = [], 0
    for line in assembly.splitlines():
        if re.match(r"\.LBB|# %bb", line):
            depth = 0
        mark = re.search(r"(?:=>|in Loop:).*Depth[= ](\d)", line)
        depth = int(mark[1]) if mark else depth
        text = line.split("#")[0].strip()
        if depth >= 2 and text and not text.startswith(".") and not text.endswith(":"):
            instructions.append(text.replace("\t", " "))
    return instructions


def kind_of(instruction: str) -> tuple[str, str]:
    """(kind, pipe)"""
    return next((kind, pipe) for kind, pipe, pattern in KINDS if re.match(pattern, instruction))


def pipe_counts(instructions: Sequence[str]) -> Counter[str]:
    counts = Counter[str]()
    for text in instructions:
        pipe = kind_of(text)[1]
        counts["decode"] += 1
        if pipe == "gather":
            counts["load"] += GATHER_LOADS
        elif " ptr [" in text:
            counts["store" if " ptr [" in text.split(",")[0] else "load"] += 1
        counts[pipe] += 1
    return counts


def processor(ir: str) -> str:
    """The processor that Dr.Jit compiles for."""
    named = re.search(r'"target-cpu"="([^"]+)"', ir)
    return named[1] if named else "native"


def mca_cycles(loop: Sequence[str], cpu: str, folder: Path) -> float:
    """Cycles per iteration of the loop, as llvm-mca simulates it: no caches, no decoder."""
    body = [re.sub(r"\.?[A-Za-z_]\w*(?=\])", "64", line) if "[rip" in line else line for line in loop if line[0] != "j"]
    (folder / "loop.s").write_text("\n".join([".intel_syntax noprefix", *body, ""]))
    flags = "-mtriple=x86_64", f"-mcpu={cpu}", f"-iterations={ITERATIONS}", "loop.s"
    said = re.search(r"Total Cycles: +(\d+)", tool("llvm-mca", *flags, folder=folder))
    assert said
    return int(said[1]) / ITERATIONS


def bound(counts: Mapping[str, float]) -> float:
    """Cycles below which instructions, counted by pipe, cannot finish, however well they overlap."""
    limits = [counts.get(name, 0) / rate for name, rate in PER_CYCLE.items()]
    for size in range(1, 5):
        for pipes in combinations(range(4), size):
            limits.append(sum(counts.get(name, 0) for name, own in PIPES.items() if own <= set(pipes)) / size)
    return max(limits)
