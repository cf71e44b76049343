"""A thread prepares piece after piece, and others work on those that are ready: one renders, and the cores measure."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from threadpoolctl import threadpool_limits

from .cores import usable_cores
from .memory import available_memory

MOST_WORKERS = 8
SHARE = 0.5  # of the memory that is free

Piece = TypeVar("Piece")
Result = TypeVar("Result")


def pipelined(work: Callable[[Piece], Result], pieces: Iterable[Piece], piece_bytes: int = 0) -> list[Result]:
    """``[work(piece) for piece in pieces]``, where ``work`` runs in a thread for each core, at most ``MOST_WORKERS``.

    Args:
        work: what holds Python's lock for most of its time gains nothing here.
        pieces: are made in the thread that calls, one by one: what is not for other threads, such as a render, belongs
            here. At most one more than there are workers exist at a time.
        piece_bytes: memory that a piece and the work on it take. There are fewer workers where it is scarce.

    Raises what ``work`` or ``pieces`` raise. No work goes on then, nor after Ctrl-C: what has begun is waited for. On
    one core there are no threads. BLAS, which has threads of its own for all cores, uses one meanwhile: workers would
    wait for each other's.
    """
    workers = _workers(piece_bytes)
    if workers == 1:
        return list(map(work, pieces))  # no piece is kept while the next is made
    with threadpool_limits(1, user_api="blas"):
        return _by_threads(work, pieces, workers)


def _by_threads(work: Callable[[Piece], Result], pieces: Iterable[Piece], workers: int) -> list[Result]:
    results: list[Result] = []
    waiting: deque[Future[Result]] = deque()
    pool = ThreadPoolExecutor(workers)
    try:
        for piece in pieces:
            waiting.append(pool.submit(work, piece))
            del piece  # it is the worker's
            if len(waiting) > workers:
                results.append(waiting.popleft().result())
        results.extend(future.result() for future in waiting)
    finally:
        pool.shutdown(cancel_futures=True)
    return results


def _workers(piece_bytes: int) -> int:
    workers, free = min(MOST_WORKERS, usable_cores()), available_memory() if piece_bytes else None
    return workers if free is None else max(1, min(workers, int(SHARE * free / piece_bytes) - 1))
