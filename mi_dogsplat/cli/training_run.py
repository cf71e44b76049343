"""A training as the commands show it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ..support.variants import set_variant
from ..support.wording import counted, duration, file_size, printable
from ..training.config import TrainConfig
from .data_notes import say_what_is_not_read
from .printing import metrics_line, say


def run_training(config: TrainConfig, out: Path, resume: bool) -> None:
    """Fill the run folder ``out`` while a bar shows how far it is, then print what came of it. Raises ``DataError``."""
    set_variant(config.variant)
    from ..report.run_folder import REPORT
    from ..runs.learned_views import learned_from
    from ..runs.run import train

    say_what_is_not_read(config.data, config.masks, config.depths)
    with shown_training(config.steps, config.split) as show:
        metrics = train(config, out, show, resume)
    split = f"{config.split} views:" if metrics["test"] else f"training views (no {config.split} view is measured):"
    say(split + " " + metrics_line(metrics["test"] or metrics["train"]))
    for line in learned_from(config.model, config.data, metrics["views"]) if config.model is not None else ():
        say(printable(line))
    size, time = file_size(metrics["bytes"]), duration(metrics["train_seconds"])
    say(f"{counted(metrics['n'], 'primitive')}, {size}, {time} of training; {out / REPORT}")


@contextmanager
def shown_training(steps: int, split: str = TrainConfig.split) -> Iterator[Callable[[dict], None]]:
    """What takes the rows of a training as progress: lines on its data, a bar up to its last step, then lines on what
    it could not do and on what follows: of which ``split`` the views are that are measured."""
    from ..training.events import NotPruned
    from .progress import Bar

    not_done: list[str] = []
    with Bar("step") as bar:

        def show(row: dict) -> None:
            if "measured" in row:
                bar.close()
                for line in not_done:
                    say(line)
                views = counted(row["measured"], f"{split} view")
                say(f"all steps are done; measuring {views} and writing the report")
                return
            for note in row.get("notes", ()):
                say(printable(note))
            events = row.get("events", ())
            not_done.extend(NotPruned(event["reason"]).text for event in events if event["kind"] == NotPruned.kind)
            figures = {}
            if "l1" in row:
                figures = {"l1": f"{row['l1']:.4f}", "n": row["n"]}
                figures |= {"psnr": f"{row['test_psnr']:.2f}"} if "test_psnr" in row else {}
            bar.show(row["step"], steps, **figures)

        yield show
