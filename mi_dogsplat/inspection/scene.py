"""``dogsplat info`` of a Mitsuba scene with ``dog`` shapes: what is in it, and who renders it."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from ..datasets.scene_file import load_scene
from ..scene.kinds import kinds_of
from ..support.wording import count, counted
from .lines import drawn, line, problem_lines, sh_degrees


def describe_scene(path: Path) -> list[str]:
    """Splats, other shapes, light and sensors of a scene. Needs a Mitsuba variant. Raises ``DataError``."""
    from ..plugin.splat_integrator import SplatIntegrator  # of the active variant
    from ..shape_dog import DogShape

    scene: Any = load_scene(path)[0]
    integrator, shapes, emitters = scene.integrator(), scene.shapes(), scene.emitters()
    splats = [shape for shape in shapes if isinstance(shape, DogShape)]
    others, lamps = len(shapes) - len(splats), sum(shape.is_emitter() for shape in shapes)
    ours = isinstance(integrator, SplatIntegrator)
    name = integrator.name if ours else integrator.class_name()
    sizes = ["{}x{}".format(*sensor.film().size()) for sensor in scene.sensors()]
    around = scene.environment()
    lines = [f"{path}: Mitsuba scene of splats, not a data set", line("integrator", name)]
    for shape in splats:
        model = shape.to_splats()
        what = f"{counted(model.n_splats, 'primitive')}, {kinds_of(model)}, SH degree {sh_degrees(model)}"
        lines += [line("splats", f"{shape.source}: {what}")]
        how = integrator.drawing.over(shape.drawing) if ours else shape.drawing
        lines += [line("drawn", drawn(how))] if how.said() else []
    lines += [
        line("other shapes", f"{count(others)}, {count(lamps)} of them emit light" if others else "none"),
        line("around", "nothing, which is black" if around is None else around.class_name()),
        line("other lights", count(len(emitters) - lamps - (around is not None))),
        line("sensors", ", ".join(sizes) or "none"),
        line("to see it", f"dogsplat render {shlex.quote(str(path))} -o picture.exr"),
    ]
    problems = [] if ours else [f"the integrator {name} does not know splats: use dogsplat or dogpath"]
    problems += [] if sizes else ["there is no sensor: nothing can be rendered"]
    if ours:
        try:
            integrator.drawn_as(scene)
        except RuntimeError as error:  # its files disagree
            problems.append(str(error).removeprefix("dogsplat: "))
    return lines + problem_lines(problems)
