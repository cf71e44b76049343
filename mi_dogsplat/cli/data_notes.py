"""What is said of a data set before a training takes its time."""

from __future__ import annotations

from pathlib import Path

from ..support.errors import DataError
from ..support.wording import printable
from .printing import say


def say_what_is_not_read(data: str, masks: str | None = None, depths: str | None = None) -> None:
    """What no reader follows in the data, and whether its cameras are too far from the origin. Masks and depth maps
    that are given take the place of those that frames name."""
    from ..datasets.far_origin import far_from_origin
    from ..datasets.numbered_models import other_models
    from ..datasets.transforms import not_read

    path = Path(data)
    try:
        lines = other_models(path) + not_read(path, masks is not None, depths is not None)
        far = far_from_origin(path)
    except DataError:  # the training says so itself, once it has looked at its model
        return
    for line in (*(f"not read: {line}" for line in lines), *far):
        say(printable(f"{data}: {line}"))
