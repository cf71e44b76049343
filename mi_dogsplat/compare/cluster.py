"""Tasks on the workers of a Dask cluster: one at https://docs.dask.org that runs already, or one on this machine.

Workers need this package and see the folder of the comparison and the data under the same paths. A worker that dies
takes nothing with it: the scheduler gives its task to another one, three times at most.
"""

from __future__ import annotations

import signal
import uuid
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from ..runs.stopping import signals_to
from ..support.errors import DataError
from .execute import Means, Outcome, in_a_process, still_possible
from .tasks import Task

SECONDS_TO_SAVE = 120  # for the largest of checkpoints on a slow disk
SECONDS_TO_ANSWER = 10  # of a scheduler


@contextmanager
def cluster_client(address: str | None, workers: int) -> Iterator[Any]:
    """A client of the scheduler at ``address``, or of a cluster of so many ``workers`` on this machine.

    Raises ``DataError`` if Dask is not installed or nobody answers.
    """
    try:
        from distributed import Client, LocalCluster
    except ModuleNotFoundError as error:
        flag = "--cluster" if address else "--workers"
        remedy = "pip install 'mi_dogsplat[cluster]', or leave the flag out"
        raise DataError(flag, f"this needs the package {error.name}", remedy) from None
    if address is None:
        with signals_to(signal.SIG_IGN, signal.SIGINT):  # a terminal sends it to the workers too: this one stops them
            cluster = LocalCluster(**local_options(workers))
        with cluster, Client(cluster) as client:
            yield client
        return
    try:
        client = Client(address, timeout=SECONDS_TO_ANSWER)
    except (OSError, ValueError) as error:
        remedy = "start `dask scheduler`, and give the address that it prints"
        raise DataError(f"--cluster {address}", f"no scheduler answers ({error})", remedy) from None
    with client:
        yield client


def local_options(workers: int) -> dict[str, Any]:
    """Of a ``LocalCluster``: no dashboard, and its HTTP server, which is there all the same, on a port that is free."""
    without_dashboard = {"scheduler_kwargs": {"dashboard": False}, "dashboard_address": "127.0.0.1:0"}
    return {"n_workers": workers, "threads_per_worker": 1, **without_dashboard}


def on_cluster(tasks: Sequence[Task], means: Means, client: Any) -> Generator[Outcome, None, None]:
    """Outcomes in the order in which tasks end. Each is submitted as soon as those that it needs have ended.

    After Ctrl-C, which is raised again, and where it is closed early, all that run save first what they have done.
    """
    from distributed import Event, as_completed, wait

    stop = Event(f"stop {uuid.uuid4().hex}", client=client)
    waiting, running = list(tasks), {}
    ended = as_completed([])

    def submit_what_is_ready() -> None:
        for task in list(waiting):
            if not any(task.needs(other) for other in (*waiting, *(task for task, _ in running.values()))):
                waiting.remove(task)
                key = f"{task.name} {uuid.uuid4().hex}"  # the same task of an earlier call is another one
                future = client.submit(in_a_process, task, means, stop.is_set, key=key, pure=False)
                running[future.key] = task, future
                ended.add(future)

    try:
        submit_what_is_ready()
        while running:
            future = next(ended)
            task, _ = running.pop(future.key)
            error = future.result() if future.status == "finished" else "its workers failed"
            if future.status == "error":
                error = f"its workers failed ({future.exception()})"
            outcome = Outcome(task, error)
            waiting[:] = still_possible(waiting, outcome)
            submit_what_is_ready()
            yield outcome
    except (KeyboardInterrupt, GeneratorExit):
        stop.set()
        with suppress(TimeoutError):  # of workers that are gone themselves
            wait([future for _, future in running.values()], timeout=SECONDS_TO_SAVE)
        raise
