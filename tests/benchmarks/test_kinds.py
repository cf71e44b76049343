"""What a kind of primitives costs is timed with all of its derivatives."""

import drjit as dr
from mi_dogsplat.scene.row_groups import BESIDE_COLORS
from mi_dogsplat.scene.splats import DENSE

from benchmarks.engine.kinds import dog, with_curvatures, with_shifts, with_slopes, with_two_cuts
from benchmarks.engine.lean import gradients
from benchmarks.engine.scaling import even_splats, front_camera


def test_derivatives_are_taken_by_all_that_a_primitive_has():
    splats = even_splats(5, 3.0, front_camera(16), 0.1)
    for add in (dog, with_slopes, with_curvatures, with_two_cuts, with_shifts):
        splats = add(splats)
    asked = set()

    def backward(params: dict) -> None:
        asked.update(name for name, value in params.items() if dr.grad_enabled(value))

    gradients(splats, backward)()
    assert asked == {*DENSE, *(name for group in BESIDE_COLORS for name in group.names)}
