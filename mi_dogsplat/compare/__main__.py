"""Performs one task of a comparison in a process of its own: ``python -m mi_dogsplat.compare TASK`` (JSON).

So the peak of memory is that of one run, nothing is left from the run before, and what kills the process is one failed
run. Whoever started it holds its standard input open. A byte there asks this process to save and end, as SIGTERM does.
When the input ends, they are gone, and this process goes too: a task that was given to another worker meanwhile has its
folder for itself.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading


def _follow_the_parent() -> None:
    while os.read(sys.stdin.fileno(), 1):  # not sys.stdin.read, whose lock the interpreter wants when it ends
        signal.raise_signal(signal.SIGTERM)
    os._exit(1)


def main() -> int:
    """Perform the task of the command line.

    The exit status is 0, 2 after one line about bad input, or 128 and the signal that stopped it.
    """
    threading.Thread(target=_follow_the_parent, daemon=True).start()
    from ..runs.stopping import Stopped
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
    except Stopped as stopped:
        print(stopped, file=sys.stderr)
        return 128 + stopped.signal_number
    return 0


if __name__ == "__main__":
    sys.exit(main())
