"""What of a scene ends the process inside of Mitsuba 3.9 (a signal, or a loop for ever), found before that is built.

Tried were 0, 1, -1 and the ends of 32 and 64 bits for each integer of Mitsuba's integrators, samplers, films and
filters, and 60 scenes of parts that do not fit together, each with six integrators. What Mitsuba refuses by itself is
not here, nor is what merely takes long, such as 2**31 ``emitter_samples``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .errors import DataError
from .scene_errors import located

MOST_SAMPLES = 2**24  # of a pixel: their weights are summed in float32, where one more would add nothing
SIZES = "width", "height", "crop_width", "crop_height"
WIDTHS = "lobes", "radius", "stddev"
METER = "irradiancemeter"  # a sensor that measures what arrives at its shape


@dataclass(frozen=True)
class Limit:
    """Of a parameter of plugins of a kind, which is a name in ``mi.ObjectType``."""

    kind: str
    parameter: str
    holds: Callable[[Any], bool]
    remedy: str


LIMITS = (
    Limit("Integrator", "samples_per_pass", lambda value: value != 0, "give 1 or more, or leave it out"),
    Limit("Sampler", "sample_count", lambda value: 1 <= value <= MOST_SAMPLES, f"give 1 to {MOST_SAMPLES}"),
    Limit("Sampler", "strength", lambda value: value >= 1, "give 1 or more"),
    *(Limit("Film", name, lambda value: value >= 1, "give 1 or more") for name in SIZES),
    *(Limit("ReconstructionFilter", name, lambda value: value >= 0, "give 0 or more") for name in WIDTHS),
)


def require_limits(path: Path, state: Any) -> None:
    """Raise ``DataError`` that names the file, the line or node, and what to do, for what would end the process.

    path: of the scene. state: what Mitsuba's parser made of it, after ``transform_all``, which gives parameters of old
    files their names of today.
    """
    import mitsuba as mi

    for node, problem, remedy in _refused(state):
        file, place, _ = located(path, f"At {mi.parser.file_location(state, node)}: ")
        raise DataError(file, place + problem, remedy)


def _refused(state: Any) -> Iterator[tuple[Any, str, str]]:
    """(node, problem, remedy) of each that is."""
    measured = set(_measured(state))
    for number, node in enumerate(state.nodes):
        props, kind = _looked_at(node), node.type.name
        plugin = props.plugin_name()
        for limit in LIMITS:
            if limit.kind == kind and limit.parameter in props and not _holds(limit, props[limit.parameter]):
                problem = f'"{limit.parameter}" of the plugin {plugin} is {props[limit.parameter]}'
                yield node, problem, limit.remedy
        if plugin == METER and number not in measured:
            yield node, f"the sensor {METER} is in no shape", "put it into the shape whose light it is to measure"


def _looked_at(node: Any) -> Any:
    """A copy of the properties of a node: Mitsuba takes those that somebody has read for used, and refuses others,
    which nobody knows."""
    import mitsuba as mi

    return mi.Properties(node.props)


def _holds(limit: Limit, value: Any) -> bool:
    """What is no number Mitsuba refuses by itself, and knows its type."""
    return not isinstance(value, (int, float)) or limit.holds(value)


def _measured(state: Any) -> Iterator[int]:
    """Numbers of the nodes that are a part of a shape; ``merge``, which Mitsuba puts around a scene, is none."""
    import mitsuba as mi

    for node in state.nodes:
        props = _looked_at(node)
        if node.type == mi.ObjectType.Shape and props.plugin_name() != "merge":
            values = (props[name] for name in props.keys())
            yield from (value.index() for value in values if isinstance(value, mi.Properties.ResolvedReference))
