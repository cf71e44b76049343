"""Performs one task of a comparison in a process of its own: ``python -m mi_dogsplat.compare TASK`` (JSON).

So the peak of memory is that of one run, nothing is left from the run before, and what kills the process is one failed
run. Whoever started it holds its standard input open; when that ends, they are gone, and this process goes too: a
task that was given to another worker meanwhile has its folder for itself.
"""

from __future__ import annotations

import json
import os
import sys
import threading


def _leave_with_the_parent() -> None:
    os.read(sys.stdin.fileno(), 1)  # not sys.stdin.read, whose lock the interpreter wants when it ends
    os._exit(1)


def main() -> int:
    """Perform the task of the command line; the exit status is 0, or 2 after one line about bad input."""
    threading.Thread(target=_leave_with_the_parent, daemon=True).start()
    from ..support.errors import DataError
    from ..support.variants import set_variant
    from .tasks import Task, perform

    given = json.loads(sys.argv[1])
    task, means = Task(**given["task"] | {"methods": tuple(given["task"]["methods"])}), given["means"]
    try:
        set_variant(means["variant"])
        if means["threads"]:
            import drjit as dr

            dr.set_thread_count(means["threads"])
        perform(task, means["free"])
    except DataError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
