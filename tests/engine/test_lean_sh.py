"""View-dependent colour costs what its degrees add, of a whole model and of primitives with degrees of their own."""

from collections import Counter

import numpy as np
import pytest
from launches import kernels, launches, llvm_only
from lean_calls import N, backward, forward, model, stages
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.scene.splats import Splats

pytestmark = pytest.mark.usefixtures("fresh_recordings")


@pytest.mark.parametrize("run", [forward, backward])
def test_every_sh_degree_costs_more_per_primitive_and_nothing_else(run):
    degrees = [launches(run(model(degree))) for degree in range(4)]
    per_primitive = [sum(k.operations for k in launched if k.size == N) for launched in degrees]
    assert per_primitive == sorted(set(per_primitive))
    others = [[(k.size, k.operations) for k in launched if k.size != N and k.kind == "JIT"] for launched in degrees]
    assert all(other == others[0] for other in others)


def test_degrees_that_are_not_active_are_not_read():
    for degree in range(3):
        stored, least = (stages(forward(model(k), sh_degree=degree))["primitives"] for k in (3, degree))
        assert stored <= 1.01 * least  # rows of another length are read in other packets


IN_GROUPS = {1: 40, 2: 30, 3: 20}  # primitives of each degree, the others have degree 0


def mixture() -> Splats:
    """Its groups are of different sizes, so that kernels can be told apart."""
    degrees = np.repeat(list(IN_GROUPS), list(IN_GROUPS.values()))
    return model(3).with_sh_degrees(np.random.default_rng(0).permutation(np.append(degrees, [0] * (N - len(degrees)))))


def test_a_mixture_of_degrees_pays_for_each_group_in_lanes_of_its_own():
    """Beside what degree 0 takes: a kernel for each group, a memset, and one load of its sums for each primitive."""
    bare, found = launches(forward(model(0))), launches(forward(mixture()))
    more = Counter(k.kind for k in found if k.kind != "JIT") - Counter(k.kind for k in bare if k.kind != "JIT")
    assert more == Counter(["Memset"] if array_types().is_llvm else [])  # the history of CUDA has no memsets
    own = [k for k in found if k.kind == "JIT" and k.size in IN_GROUPS.values()]
    assert [k.size for k in own] == list(IN_GROUPS.values())
    others = [k for k in found if k.kind == "JIT" and k not in own]
    assert [k.size for k in others] == [k.size for k in bare if k.kind == "JIT"]
    more = [k.operations - b.operations for k, b in zip(others, [k for k in bare if k.kind == "JIT"], strict=True)]
    assert sum(more) == max(more) <= 10
    costs = [k.operations for k in own]
    assert costs == sorted(set(costs)) and costs[-1] < 400  # a projection with degree 3 takes 918


@llvm_only
def test_the_bands_of_a_group_are_all_that_its_lanes_read():
    found = {k.size: k.instructions for k in launches(forward(mixture())) if k.kind == "JIT"}
    for degree, size in IN_GROUPS.items():
        single, of_four = (sum(count for name, count in found[size].items() if part in name)
                           for part in ("masked.gather", "gather_4x"))
        assert (single, of_four) == (3, {1: 3, 2: 6, 3: 12}[degree])  # its centre; 9, 24 and 45 floats by four


def test_a_mixture_rendered_with_its_constant_colour_is_a_model_of_degree_0():
    bare, found = launches(forward(model(0))), launches(forward(mixture(), sh_degree=0))
    assert [(k.kind, k.size, k.instructions) for k in found] == [(k.kind, k.size, k.instructions) for k in bare]


def test_a_lower_degree_leaves_the_bands_above_out_of_every_group():
    costs = [{k.size: k.operations for k in launches(forward(mixture(), sh_degree=degree)) if k.kind == "JIT"}
             for degree in (1, 2, 3)]
    assert costs[0][20] < costs[1][20] < costs[2][20] and costs[0][30] < costs[1][30] == costs[2][30]
    assert costs[0][40] == costs[1][40] == costs[2][40]


def test_the_derivative_of_a_mixture_takes_small_kernels_more_than_that_of_degree_0():
    """Adjoints of colours for the groups, less the rows that later groups store, the groups, and sums for the centres,
    which both parts move."""
    bare, found = kernels(backward(model(0))), kernels(backward(mixture()))
    of_groups = [(size, k) for size, k in found if size in IN_GROUPS.values()]
    each = 2 if array_types().is_llvm else 3  # forward, on CUDA once more in the derivative, and backward
    assert len(of_groups) == each * len(IN_GROUPS)
    more = Counter(size for size, _ in found) - Counter(size for size, _ in bare)
    assert more == Counter({**dict.fromkeys(IN_GROUPS.values(), each), N: 2, 3 * N: 1, 4 * N: len(IN_GROUPS) - 1})
    cost = [sum(k for size, k in launched if size in (N, 3 * N)) for launched in (bare, found)]
    # on CUDA the derivative projects anew, and once more for the colours that the groups' kernels wait for
    assert cost[1] < (1.1 if array_types().is_llvm else 1.3) * cost[0]


@pytest.mark.parametrize("run", [forward, backward])
def test_a_uniform_model_runs_no_code_of_groups(run, monkeypatch):
    bare = launches(run(model(3)))

    def never(*_):
        raise AssertionError("called")

    monkeypatch.setattr("mi_dogsplat.engine.project.evaluate_groups", never)
    monkeypatch.setattr("mi_dogsplat.engine.project.has_groups", lambda params: False)
    assert [(k.kind, k.size, k.instructions) for k in launches(run(model(3)))] == [
        (k.kind, k.size, k.instructions) for k in bare
    ]
