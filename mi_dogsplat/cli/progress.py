"""A bar for what takes long."""

from __future__ import annotations

from typing import Any

from .printing import say


class Bar:
    """``with Bar("step") as bar``: it appears with the first ``show``, so that an error before it is a single line."""

    def __init__(self, unit: str, title: str | None = None):
        from tqdm import tqdm  # here: it is of the extra "train"

        self._options: dict[str, Any] = {"unit": unit, "dynamic_ncols": True, "smoothing": 0.05, "desc": title}
        self._make = tqdm
        self._bar: tqdm | None = None

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """It stays as it is, with the time that it took until now."""
        if self._bar is not None:
            self._bar.close()

    def show(self, done: int, total: int = 0, first: str = "", **figures: Any) -> None:
        """How far it is, of a ``total`` that may be unknown (0).

        ``first`` is a line above the bar, ``figures`` stand behind it until others come.
        """
        if self._bar is None:
            if first:
                say(first)
            # what was done before it appears, as by a start that this one resumes, tells nothing of the speed
            self._bar = self._make(total=total or None, initial=done, **self._options)
        self._bar.update(done - self._bar.n)
        if figures:
            self._bar.set_postfix(figures)


class StageBars:
    """``with StageBars() as bars``: a bar for each stage of what has several, one below the other."""

    def __init__(self) -> None:
        self._stage, self._bar = "", None

    def __enter__(self) -> StageBars:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.__exit__()

    def show(self, stage: str, done: int, total: int) -> None:
        """How far a stage is; another one than before begins."""
        if self._bar is None or stage != self._stage:
            self.__exit__()
            self._stage, self._bar = stage, Bar("", stage)
        self._bar.show(done, total)
