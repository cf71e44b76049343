"""Whether the model of a run learned nothing of what masks hide, which others count unless they are told to."""

from __future__ import annotations

from pathlib import Path

from ..support.errors import DataError
from .inputs import noted_inputs
from .model_files import model_files


def without_masks_of_run(model: str | Path, masks: str | None) -> list[str]:
    """A line where a model was trained with masks, and photographs are looked at without any (``masks`` is None).

    None where nobody knows: of a model that does not lie in the folder of its run.
    """
    path = Path(model).resolve()
    if masks or path not in model_files(path.parent):
        return []
    try:
        own = noted_inputs(path.parent).get("masks")
    except (DataError, OSError):
        return []
    return [f"{model} was trained with masks; what they hide counts here unless you give --masks {own}"] if own else []
