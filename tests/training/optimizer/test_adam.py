"""The layout of Adam's state in the installed Dr.Jit is the one that ``adam.py`` unpacks."""

from importlib.metadata import version

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.training.optimizer.adam import CHECKED_WITH, Entry, forget, step_without
from mi_dogsplat.training.optimizer.adam_step import adam_step, library_step, replayed_step
from same_numbers import assert_same_numbers


def adam_after(steps: int) -> mi.ad.Adam:
    adam = mi.ad.Adam(lr=0.1, params={"a": mi.Float([1.0, 2.0]), "b": mi.Float([3.0])})
    for _ in range(steps):
        for name in adam:
            dr.set_grad(adam[name], mi.Float(np.full(dr.width(adam[name]), 0.5)))
        adam.step()
    return adam


def test_an_entry_holds_what_adam_has_computed():
    """After t steps with the gradient g: m = (1 - β₁ᵗ) g, v = (1 - β₂ᵗ) g²."""
    installed = version("drjit")
    assert installed.startswith(f"{CHECKED_WITH}."), f"look at the state of Adam in Dr.Jit {installed}"
    adam = adam_after(3)
    entry = Entry.of(adam, "a")
    np.testing.assert_allclose(entry.m.numpy(), (1 - 0.9**3) * 0.5, rtol=1e-5)
    np.testing.assert_allclose(entry.v.numpy(), (1 - 0.999**3) * 0.25, rtol=1e-3)
    assert int(entry.t[0]) == 3 and entry.v_max is None
    np.testing.assert_array_equal(entry.value.numpy(), adam["a"].numpy())


def test_an_entry_that_is_put_back_changes_no_step():
    adam, same = adam_after(3), adam_after(3)
    Entry.of(same, "a").put(same, "a")
    for one in (adam, same):
        for name in one:
            dr.set_grad(one[name], mi.Float(1))
        one.step()
    np.testing.assert_array_equal(adam["a"].numpy(), same["a"].numpy())


def test_without_moments_only_the_count_of_steps_is_left():
    entry = Entry.of(adam_after(3), "a").without_moments()
    assert not entry.m.numpy().any() and not entry.v.numpy().any() and len(entry.m) == 2 and int(entry.t[0]) == 3


def test_a_step_without_a_parameter_counts_for_it_and_keeps_the_order():
    adam = adam_after(3)
    before = adam["a"].numpy()
    for name in adam:
        dr.set_grad(adam[name], mi.Float(1))
    step_without(adam, {"a"})
    assert list(adam) == ["a", "b"] and int(Entry.of(adam, "a").t[0]) == int(Entry.of(adam, "b").t[0]) == 4
    np.testing.assert_array_equal(adam["a"].numpy(), before)
    forget(adam, "a")
    assert list(adam) == ["b"]


@pytest.mark.parametrize("step_of", [library_step, replayed_step])
@pytest.mark.parametrize("epsilon", [1e-15, 1e-7])
def test_a_step_is_that_of_the_library(epsilon, step_of):
    """Several in turn, the counts of steps differ, and a parameter is left out now and then."""
    def begun() -> mi.ad.Adam:
        values = {"a": mi.Float([1.0, 2.0]), "b": mi.Float([3.0])}
        adam = mi.ad.Adam(0.1, values, beta_1=0.8, beta_2=0.99, epsilon=epsilon)
        adam.set_learning_rate({"a": 0.05, "b": 0.2})
        return adam

    ours, library = begun(), begun()
    for step in range(6):
        unused = {"b"} if step in (1, 2) else set()
        for adam in (ours, library):
            for k, name in enumerate(adam):
                size = dr.width(adam[name])
                dr.set_grad(adam[name], mi.Float(np.cos(np.arange(size) + k + step)) if name not in unused else 0)
        before = {name: adam_of.numpy() for name, adam_of in library.items()}
        found = step_of(ours, unused, [name for name in ("b", "a") if name not in unused])
        step_without(library, unused)
        for name in ours:
            a, b = Entry.of(ours, name), Entry.of(library, name)
            assert a.steps == b.steps == step + 1
            for mine, theirs in ((a.value, b.value), (a.m, b.m), (a.v, b.v)):
                np.testing.assert_allclose(mine.numpy(), theirs.numpy(), rtol=1e-6)
        for name, (value, gradient) in found.items():
            np.testing.assert_allclose(value.numpy(), before[name], rtol=1e-6)
            k, size = list(ours).index(name), dr.width(ours[name])
            assert_same_numbers(gradient.numpy(), np.cos(np.arange(size) + k + step).astype(np.float32))


@pytest.mark.parametrize("step_of", [adam_step, library_step, replayed_step])
def test_a_gradient_that_is_no_number_or_has_no_square_moves_nothing(step_of):
    adam = mi.ad.Adam(0.1, {"a": mi.Float([1.0, 2.0, 3.0, 4.0])}, beta_1=0.9, beta_2=0.999, epsilon=1e-15)
    adam.set_learning_rate({"a": 0.1})
    dr.set_grad(adam["a"], mi.Float([np.nan, np.inf, 1e30, 1.0]))
    step_of(adam, (), ())
    entry = Entry.of(adam, "a")
    np.testing.assert_array_equal(entry.value.numpy()[:3], [1, 2, 3])
    assert entry.value.numpy()[3] < 4 and np.isfinite(entry.v.numpy()).all()
