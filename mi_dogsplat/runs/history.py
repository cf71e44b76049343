"""A training to its end, as the rows of ``history.jsonl``: what is measured when, and by which clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import drjit as dr

from ..training.events import DogActivated, Event, Pruned, row_of
from ..training.given_rows import GIVEN
from ..training.train import Trainer


def run_to_end(
    trainer: Trainer,
    due: Callable[[], bool] = lambda: False,
    save: Callable[[], None] = lambda: None,
    until: int | None = None,
) -> Iterator[dict[str, Any]]:
    """Run to the end; yields rows of the history.

    Every row has ``step``, ``seconds`` (without ``save`` and measurements on test views), ``n`` and ``n_dog``, and the
    ``counted_rows``. Some have means since the row before (``l1``, ``loss``), means over the test views (``test_psnr``;
    ``test_flip`` where it is not a prune or an activation that asks), and what happened (``events.row_of``).
    After a step, and after its row, ``save`` is called where that is ``due``. ``until`` is a step before the end.
    """
    config = trainer.config
    test_every = (config.test_every or max(1, config.steps // 8)) if trainer.dataset.test else 0
    tick = time.perf_counter()
    for happened in _happenings(trainer, config.steps if until is None else until):
        log = trainer.losses.views > 0 and trainer.logs()
        scheduled = test_every > 0 and trainer.step_count % test_every == 0
        compacted = test_every > 0 and any(isinstance(event, Pruned | DogActivated) for event in happened)
        if happened or log or scheduled:
            row: dict[str, Any] = {"step": trainer.step_count}
            if log:
                row |= trainer.losses.take()
            _count_seconds(trainer, tick)
            row |= {"seconds": trainer.seconds, "n": trainer.optimizer.n, "n_dog": trainer.optimizer.n_dog}
            row |= counted_rows(trainer)
            row |= row_of(happened)
            if scheduled or compacted:
                row |= trainer.test_errors(with_flip=scheduled)
            tick = time.perf_counter()
            yield row
        if due():
            _count_seconds(trainer, tick)
            save()
            tick = time.perf_counter()
    if until is not None:  # there need not be a row at the last step
        _count_seconds(trainer, tick)


def counted_rows(trainer: Trainer) -> dict[str, int]:
    """Numbers of rows of ``GIVEN``, as models name them, each where there are some, or are to be."""
    numbers = {name: len(trainer.optimizer.index_of(rows.group)) for name, rows in GIVEN.items()}
    return {f"n_{name}": n for name, n in numbers.items() if n or name in trainer.recipe.row_rules}


def _count_seconds(trainer: Trainer, since: float) -> None:
    """Add what the device and we have worked since then."""
    dr.sync_thread()
    trainer.seconds += time.perf_counter() - since


def _happenings(trainer: Trainer, until: int) -> Iterator[list[Event]]:
    """What happens before the first step and after the last of the run, if anything does, and at every step."""
    if due := trainer.begin():
        yield due
    while trainer.step_count < until:
        yield trainer.step()
    if trainer.step_count == trainer.config.steps and not trainer.ended and (due := trainer.end()):
        yield due
