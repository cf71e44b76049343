"""Files of models."""

from pathlib import Path

from mi_dogsplat import Model, Splats, write_model


def written(path: Path, model: Model | Splats, **how) -> Path:
    """The file, which holds the model now; ``how`` as for ``write_model``."""
    write_model(path, model, **how)
    return path
