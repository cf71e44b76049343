"""Damaged files by the ten thousands for every reader: ``python -m tests.fuzz [TARGET ...] [--inputs N] [--seed S]``.

Each target runs in a process of its own with a limit on its memory. What breaks the invariant of ``fuzz_targets.py``
(also by killing the process) is written to ``fuzz_failures/`` with the target's name, and shown. ``--atheris`` mutates
by coverage instead (``pip install 'mi_dogsplat[fuzz]'``, Python 3.11), one target at a time.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import resource
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "helpers")]  # as pytest does
from mutations import mutate  # noqa: E402

MEMORY = 1 << 30  # bytes that a reader may ask for beyond what the process has at the start
FAILURES = Path("fuzz_failures")
HANG = 10.0  # seconds of the processor
SHOWN = 12  # different failures of a target


def limit_memory() -> None:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))


def hang(*_: object) -> None:
    raise TimeoutError(f"more than {HANG:.0f} s")


def fuzz(name: str, inputs: int, seed: int, connection: Connection) -> None:
    """Run a target; sends (outcomes, seconds, failures: where it was raised -> input)."""
    from fuzz_targets import make_targets

    target = make_targets()[name]
    chance = random.Random(f"{name} {seed}")
    warnings.simplefilter("error")
    warnings.filterwarnings("ignore", module="PIL")  # it warns of what it then reads or refuses
    signal.signal(signal.SIGPROF, hang)
    limit_memory()
    outcomes: Counter[str] = Counter()
    failures: dict[str, bytes] = {}
    current = target.folder / "current input"  # what kills the process is found here
    start = time.perf_counter()
    for _ in range(inputs):
        data = mutate(target.seeds, chance)
        current.write_bytes(data)
        signal.setitimer(signal.ITIMER_PROF, HANG)
        try:
            outcomes[target.check(data)] += 1
        except BaseException as error:  # whatever it is, it is not DataError
            outcomes["FAILED"] += 1
            trace = traceback.extract_tb(error.__traceback__)
            frame = next((f for f in reversed(trace) if "mi_dogsplat" in f.filename), trace[-1])
            key = f"{type(error).__name__} at {Path(frame.filename).name}:{frame.lineno}: {str(error)[:150]}"
            known = {failure.split(": ")[0] for failure in failures}
            if len(failures) < SHOWN and key.split(": ")[0] not in known:
                failures[key] = data
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
    connection.send((outcomes, time.perf_counter() - start, failures))


def run_target(name: str, inputs: int, seed: int) -> bool:
    """Whether every input of a target kept the invariant; prints a line, and the failures."""
    context = get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=fuzz, args=(name, inputs, seed, theirs))
    process.start()
    theirs.close()
    try:
        outcomes, seconds, failures = ours.recv()
    except EOFError:
        process.join()
        outcomes, seconds, failures = Counter(FAILED=1), 1.0, {f"the process died ({process.exitcode})": b""}
    process.join()
    print(f"| {name} | {inputs:,} | {outcomes['read']:,} | {outcomes['refused']:,} | {outcomes['FAILED']:,} "
          f"| {inputs / seconds:,.0f} |", flush=True)  # fmt: skip
    for key, data in failures.items():
        FAILURES.mkdir(exist_ok=True)
        path = FAILURES / f"{name}-{hashlib.sha256(data).hexdigest()[:12]}"
        path.write_bytes(data)
        print(f"    {key}  [{path}]", flush=True)
    return not failures


def run_atheris(name: str, rest: list[str]) -> None:
    """Mutations guided by coverage, until stopped; ``rest`` are libFuzzer's own arguments."""
    try:
        import atheris  # pyright: ignore[reportMissingImports, reportMissingModuleSource]
    except ModuleNotFoundError:
        sys.exit("this needs the package atheris: pip install 'mi_dogsplat[fuzz]'")
    with atheris.instrument_imports(include=["mi_dogsplat"]):  # pyright: ignore[reportAttributeAccessIssue]
        from fuzz_targets import make_targets

    target = make_targets()[name]
    corpus = target.folder.with_name("corpus")
    corpus.mkdir()
    for i, seed in enumerate(target.seeds):
        (corpus / str(i)).write_bytes(seed)

    def check(data: bytes) -> None:
        target.check(bytes(data))

    atheris.Setup([sys.argv[0], str(corpus), *rest], check)
    atheris.Fuzz()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", help="default: all")
    parser.add_argument("--inputs", type=int, default=5000, help="of each target (default: 5000)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--atheris", action="store_true", help="one target; arguments after -- go to libFuzzer")
    args, rest = parser.parse_known_args()
    if args.atheris:
        run_atheris(args.targets[0], [word for word in rest if word != "--"])
        return 0
    from fuzz_targets import make_targets

    print("| target | inputs | read | refused | failed | inputs/s |\n|---|---|---|---|---|---|")
    names = args.targets or list(make_targets())
    return 0 if all([run_target(name, args.inputs, args.seed) for name in names]) else 1


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
