"""Which views the model of a run has learned from: measured on these, it looks better than it is."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ..report.run_folder import CONFIG, REFINED, REMEDY
from ..support.arrays import read_array
from ..support.errors import DataError
from ..support.files import read_object
from .checkpoint import CHECKPOINT
from .inputs import is_same_input, noted_inputs
from .model_files import model_files


def learned_from(model: str | Path, data: str | Path, measured: Iterable[str]) -> list[str]:
    """A line where a model has learned from some of the views of a data set that are ``measured``, by their names.

    None where nobody knows: of a model that does not lie in the folder of its run, and of runs on other data or without
    a checkpoint.
    """
    run, names = Path(model).resolve().parent, list(measured)
    if Path(model).resolve() not in model_files(run):
        return []
    try:
        own = is_same_input(read_object(run / CONFIG, REMEDY)["data"], str(data), noted_inputs(run).get("data"))
        same = own or Path(data).resolve() == (run / REFINED).resolve()  # the same views, elsewhere
        learned = set(read_array(run / CHECKPOINT, "views").tolist()) if same else set()
    except (DataError, OSError, ValueError, KeyError):
        return []
    known = sum(name in learned for name in names)
    problem = f"{model} was trained on {known} of the {len(names)} measured views, which make it look better than it is"
    return [problem] if known else []
