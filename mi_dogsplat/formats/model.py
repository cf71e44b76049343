"""What a model file holds: primitives, how they are to be drawn, and what of the file was left out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..scene.drawing import Drawing, differences
from ..scene.row_groups import GROUPS
from ..scene.splats import DENSE, Splats
from ..support.classes import require_class
from ..support.errors import DataError


@dataclass(frozen=True)
class Model:
    """The content of a model file.

    Raises ``ValueError`` for primitives that are no ``Splats``, and for a drawing that is no ``Drawing``.
    """

    splats: Splats
    """in the axes of 3DGS PLY: right, down, forward"""
    drawing: Drawing = Drawing()
    left_out: tuple[str, ...] = ()
    """a line for each thing in the file that has no place here"""

    def __post_init__(self) -> None:
        remedy = 'that of a shape "dog" is Model(shape.to_splats(), shape.drawing), that of a file read_model(path)'
        require_class("Model: what has its primitives", self.splats, Splats, remedy)
        require_class("Model: how it is drawn", self.drawing, Drawing, 'give a Drawing, as Drawing(up="z")')

    def joined(self, *others: Model) -> Model:
        """One model of this one and others, as ``Splats.joined`` makes it; what one of them says on its drawing holds.

        Raises ``ValueError`` where they are not drawn alike: then the pictures of some, or the place that they say to
        have, would change. What a model does not say counts as what is usual: sRGB colours that are not antialiased, a
        near clip of 0.2, white at 1, -y up, and a metre as its unit. Raises it for what is no model, too.
        """
        remedy = "that of Splats alone is Model(splats), those of a list are Model.joined(*models)"
        for k, other in enumerate(others, 1):
            require_class(f"Model.joined: model {k}", other, Model, remedy)
            if different := differences(self.drawing, other.drawing):
                raise ValueError(
                    f"Model.joined: model 0 and model {k} are not drawn alike: {', '.join(different)}; "
                    "make them alike first, or join their splats and say how the whole is drawn"
                )
        drawing = self.drawing
        for other in others:
            drawing = drawing.over(other.drawing)
        left_out = tuple(dict.fromkeys(line for model in (self, *others) for line in model.left_out))
        return Model(self.splats.joined(*(other.splats for other in others)), drawing, left_out)


def require_finite(path: Path, splats: Splats, remedy: str) -> None:
    """Raise ``DataError`` about a file where a number of its model is none, with the first such primitive."""
    of_groups = {name: getattr(splats, group.index) for group in GROUPS for name in group.names}
    for name in (*DENSE, *of_groups):
        bad = np.argwhere(~np.isfinite(getattr(splats, name)))
        if len(bad):
            first = of_groups[name][bad[0][0]] if name in of_groups else bad[0][0]
            problem = f"has values of {name} that are not finite: {len(bad)}, the first in primitive {first}"
            raise DataError(path, problem, remedy)
