"""A bar for what takes long."""

from __future__ import annotations

from typing import Any


class Bar:
    """``with Bar("step") as bar``: it appears with the first ``show``, so that an error before it is a single line."""

    def __init__(self, unit: str):
        from tqdm import tqdm  # here: it is of the extra "train"

        self._options: dict[str, Any] = {"unit": unit, "dynamic_ncols": True, "smoothing": 0.05}
        self._make = tqdm
        self._bar: tqdm | None = None

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def show(self, done: int, total: int, first: str = "", **figures: Any) -> None:
        """How far it is; ``first`` is a line above the bar, ``figures`` stand behind it until others come."""
        if self._bar is None:
            if first:
                print(first, flush=True)
            self._bar = self._make(total=total, **self._options)
        self._bar.update(done - self._bar.n)
        if figures:
            self._bar.set_postfix(figures)
