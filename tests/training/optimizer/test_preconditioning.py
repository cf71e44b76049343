"""Joint steps of a primitive's numbers: against NumPy in float64, as rows come and go, across checkpoints."""

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.scene.row_groups import CUTS, DOG, PLANES, SECOND_CUTS
from mi_dogsplat.training.images.tone_curve import SrgbLog
from mi_dogsplat.training.optimizer.preconditioning import JOINT, PRIOR, Preconditioning
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from small_optimizer import (
    RATES,
    alike,
    assert_nothing_is_compiled,
    assert_same,
    assert_same_state,
    random_model,
    run,
    set_gradients,
    state_from_file,
)

RULE = Preconditioning(start=0, gain=1.7, damping=0.2, memory=0.9)
JOINTLY = replace(RATES, preconditioning=RULE)
ROWS = {"slope_index": (1, 2), "cut_index": (0, 2, 5), "second_cut_index": (2, 3, 5)}


def correlated(optimizer: SplatOptimizer, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Gradients of which a primitive's share a large part, of different sizes."""
    shared = rng.normal(size=optimizer.n)
    gradients = {}
    for k, (name, value) in enumerate(optimizer.adam.items()):
        size = optimizer.row_size[name]
        rows = dr.width(value) // size
        own = shared[:rows, None] * np.arange(1, size + 1) + rng.normal(size=(rows, size))
        gradients[name] = (10.0**-k * own).ravel().astype(np.float32)
        dr.set_grad(value, mi.Float(gradients[name]))
    return gradients


def products_of(optimizer: SplatOptimizer) -> np.ndarray:
    (found,) = [values for name, values in optimizer.state().items() if name.startswith("products")]
    return found


class Twin:
    """The rule and Adam in float64, a loop over primitives."""

    def __init__(self, optimizer: SplatOptimizer, rule: Preconditioning):
        self.rule = rule
        self.sizes = dict(optimizer.row_size)
        rows = {name: optimizer.index_of(group) for group in (DOG, CUTS, SECOND_CUTS) for name in group.names}
        everybody = np.arange(optimizer.n)
        self.who = {name: rows.get(name, everybody) for name in JOINT if name in optimizer.adam}
        self.value: dict[str, Any] = {
            name: optimizer.numpy(name).reshape(-1, self.sizes[name]).astype(np.float64) for name in self.who
        }
        self.m, self.v = ({name: np.zeros_like(x) for name, x in self.value.items()} for _ in range(2))
        self.S: dict[int, Any] = {}
        self.t = 0

    def of_primitive(self, arrays: dict[str, np.ndarray], i: int) -> np.ndarray:
        """Its numbers; 0 where it has no row."""
        found = [arrays[name][who == i] if i in who else np.zeros(self.sizes[name]) for name, who in self.who.items()]
        return np.concatenate([np.ravel(x) for x in found])

    def step(self, gradients: dict[str, np.ndarray], rates: dict[str, float]) -> None:
        self.t += 1
        g = {name: np.float64(gradients[name]).reshape(-1, self.sizes[name]) for name in self.who}
        for name in self.who:
            self.m[name] = 0.9 * self.m[name] + 0.1 * g[name]
            self.v[name] = 0.999 * self.v[name] + 0.001 * g[name] ** 2
        first, second = 1 - 0.9**self.t, 1 - 0.999**self.t
        for i in range(len(self.value["means"])):
            own, square = self.of_primitive(g, i), self.of_primitive(self.v, i)
            scale = np.sqrt(second / np.maximum(square, 1e-30))
            own, before = own * scale, self.S.get(i, 0.2 * np.eye(len(own)))
            S = self.S[i] = self.rule.memory * before + (1 - self.rule.memory) * np.outer(own, own)
            size = np.sqrt(np.diag(S))
            C, u = S / size[:, None] / size, self.of_primitive(self.m, i) / first * scale
            Δ = (1 + self.rule.damping) * np.linalg.solve(C + self.rule.damping * np.eye(len(u)), u)
            for name, who in self.who.items():
                own, Δ = Δ[: self.sizes[name]], Δ[self.sizes[name] :]
                self.value[name][who == i] -= self.rule.gain * rates[name] * own


@pytest.mark.parametrize("rows", [{}, ROWS])
@pytest.mark.parametrize("dog_index", [(), (0, 3)])
def test_steps_agree_with_float64(rows, dog_index):
    optimizer, rng = SplatOptimizer(random_model(6, 1, dog_index, rows=rows), JOINTLY), np.random.default_rng(5)
    adam, twin = SplatOptimizer(optimizer.to_splats(), RATES), Twin(optimizer, RULE)
    for step in range(8):
        for each in (optimizer, adam):
            each.schedule(100 * step)
        gradients = correlated(optimizer, rng)
        for name, gradient in gradients.items():
            dr.set_grad(adam.adam[name], mi.Float(gradient))
        for each in (optimizer, adam):
            each.step()
        twin.step(gradients, RATES.at(100 * step))
    for name in optimizer.adam:
        got, plain = optimizer.numpy(name), adam.numpy(name)
        if name not in JOINT:
            np.testing.assert_array_equal(got, plain, err_msg=name)
            continue
        atol = 1e-4 * RULE.gain * RATES.at(0)[name]  # of a step: equations are solved in float32
        np.testing.assert_allclose(got.reshape(twin.value[name].shape), twin.value[name], rtol=1e-6, atol=8 * atol)
        assert np.abs(got - plain).max() > 1e-4, name


def test_a_number_whose_gradient_is_the_only_one_steps_as_in_adam_times_the_gain():
    model = replace(random_model(5, 0), logit_opacities=np.zeros(5))
    jointly, adam = (SplatOptimizer(model, rates) for rates in (JOINTLY, RATES))
    for step in range(4):
        for optimizer in (jointly, adam):
            optimizer.schedule(step)
            dr.set_grad(optimizer.adam["logit_opacities"], mi.Float(np.cos(np.arange(5) + step)))
            optimizer.step()
    moved = [optimizer.numpy("logit_opacities") for optimizer in (jointly, adam)]
    np.testing.assert_allclose(moved[0], RULE.gain * moved[1], rtol=1e-5)
    assert np.abs(moved[1]).min() > 1e-3
    np.testing.assert_array_equal(jointly.numpy("means"), model.means)


def test_before_its_start_the_rule_changes_no_bit():
    late = replace(RATES, preconditioning=replace(RULE, start=4))
    waiting, plain = (SplatOptimizer(random_model(6, 1, (2,)), rates) for rates in (late, RATES))
    for optimizer in (waiting, plain):
        run(optimizer, 4)
    assert_same_state(waiting, plain)
    for optimizer in (waiting, plain):
        optimizer.schedule(4)
        set_gradients(optimizer, np.random.default_rng(3))
        optimizer.step()
    assert np.abs(waiting.numpy("means") - plain.numpy("means")).max() > 1e-5


def test_along_narrow_valleys_it_comes_closer_than_adam():
    """½ (x - y)ᵀ H (x - y) of each primitive with curvatures of 1 to 100, gradients as noisy as they are steep."""
    rng, n = np.random.default_rng(0), 40
    turned = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    H = turned @ (np.array([1.0, 10.0, 100.0])[:, None] * turned.transpose(0, 2, 1))
    noise, left = 0.01 * np.einsum("nij,snj->sni", np.linalg.cholesky(H), rng.normal(size=(400, n, 3))), []
    for rates in (RATES, replace(RATES, preconditioning=Preconditioning(0, gain=1.0, damping=0.3, memory=0.99))):
        optimizer = SplatOptimizer(random_model(n, 0), rates)
        target = optimizer.numpy("means") + 0.01
        for step in range(400):
            optimizer.schedule(2 * step)
            gradient = np.einsum("nij,nj->ni", H, optimizer.numpy("means") - target) + noise[step]
            dr.set_grad(optimizer.adam["means"], mi.Float(gradient.ravel().astype(np.float32)))
            optimizer.step()
        away = optimizer.numpy("means") - target
        left.append(np.einsum("ni,nij,nj->", away, H, away))
    assert left[1] < 0.7 * left[0]


def test_gradients_that_are_all_alike_take_no_step_that_is_too_long():
    optimizer = SplatOptimizer(random_model(5, 0, (1,)), JOINTLY)
    before = {name: optimizer.numpy(name) for name in optimizer.adam}
    alike(optimizer, 0)
    for name in JOINT[:5]:
        moved = np.abs(optimizer.numpy(name) - before[name])
        longest = 3 * RULE.gain * RATES.at(0)[name]
        assert 0 < moved.min() and moved.max() < longest, name


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
def test_a_gradient_without_a_finite_square_counts_as_zero(value):
    broken, zeroed = (SplatOptimizer(random_model(5, 0), JOINTLY) for _ in range(2))
    for optimizer, replacement in ((broken, value), (zeroed, 0.0)):
        rng = np.random.default_rng(0)
        for step in range(4):
            gradients = set_gradients(optimizer, rng)
            if step == 1:
                gradients["means"][4] = replacement
                dr.set_grad(optimizer.adam["means"], mi.Float(gradients["means"]))
            optimizer.step()
    assert_same_state(broken, zeroed)


def test_what_is_known_of_a_primitive_moves_along_with_it():
    """Each primitive is on its own: those that stay, in any order, go on as if nothing had happened."""
    model = random_model(6, 0, (0, 3), rows=ROWS)
    whole, part = (SplatOptimizer(model, JOINTLY) for _ in range(2))
    for optimizer in (whole, part):
        run(optimizer, 3)
    order = np.array([5, 0, 3])
    part.keep(order)
    gradients = correlated(whole, np.random.default_rng(2))
    of_part = {"dog_": [0, 1], "cut_": [2, 0], "seco": [2, 1], "colo": []}  # of 0 and 3, 5 and 0, 5 and 3, of none
    for name, value in part.adam.items():
        rows = gradients[name].reshape(-1, whole.row_size[name])
        dr.set_grad(value, mi.Float(rows[of_part.get(name[:4], order)].ravel()))
    for optimizer in (whole, part):
        optimizer.step()
    for name in ("means", "quats", "sh_dc"):
        np.testing.assert_array_equal(part.numpy(name), whole.numpy(name)[order], err_msg=name)
    for name, rows in (("cut_normals", [2, 0]), ("second_cut_normals", [2, 1])):
        np.testing.assert_array_equal(part.numpy(name).reshape(2, 3), whole.numpy(name).reshape(3, 3)[rows])


def test_a_new_primitive_begins_as_all_have_begun():
    """Nothing goes together, and not all with all, as its first gradient alone would have it."""
    optimizer = SplatOptimizer(random_model(3, 0, (2,)), JOINTLY)
    run(optimizer, 3)
    optimizer.rearrange(np.array([0, 1, 2, 2]), np.array([False, False, False, True]))
    products = products_of(optimizer)
    row, column = np.tril_indices(18)  # in the order of the entries: 14 numbers, and 4 of DoG
    np.testing.assert_array_equal(products[:, 3], np.float32(PRIOR) * (row == column))
    assert np.abs(products[row != column, 0]).max() > 0.01


def test_a_row_that_is_lost_turns_no_step_from_then_on():
    """What is left of its primitive steps as if that had never had one; gradients do not depend on values here."""
    models = [random_model(3, 0, dog_index, rows={"cut_index": (1,)}) for dog_index in ((0, 1), (0,))]
    had, plain = (SplatOptimizer(model, JOINTLY) for model in models)
    rng = np.random.default_rng(6)
    for step in range(5):
        if step == 4:
            had.drop_dog(mi.Bool([False, True, False]))
            before = [optimizer.numpy("means")[1] for optimizer in (had, plain)]
        gradients = correlated(had, rng)
        for name, value in plain.adam.items():
            dr.set_grad(value, mi.Float(gradients[name][: dr.width(value)]))
        for optimizer in (had, plain):
            optimizer.schedule(step)
            optimizer.step()
    moved = [optimizer.numpy("means")[1] - x for optimizer, x in zip((had, plain), before, strict=True)]
    np.testing.assert_allclose(moved[0], moved[1], rtol=0, atol=1e-3 * RATES.at(4)["means"])
    assert np.abs(before[0] - before[1]).max() > 0.01 * RATES.at(4)["means"]
    products = [products_of(optimizer)[:, 1] for optimizer in (had, plain)]
    np.testing.assert_allclose(*products, rtol=0, atol=1e-6)
    of_dog = np.arange(14, 18)  # after 14 numbers that all have
    own = products[0][of_dog * (of_dog + 3) // 2]
    np.testing.assert_array_equal(own, np.float32(PRIOR))  # another row would begin as all do


@pytest.mark.parametrize("plane", PLANES, ids=["first", "second"])
def test_rows_that_come_later_step_from_then_on_and_take_nothing_from_the_others(plane):
    (normals,) = plane.names
    plain, later = (SplatOptimizer(random_model(4, 0), JOINTLY) for _ in range(2))
    for optimizer in (plain, later):
        run(optimizer, 3)
    later.set_rows(plane, np.array([1, 2]), {normals: np.zeros((2, 3))})
    for step in range(3):
        gradients = set_gradients(plain, np.random.default_rng(step))
        for name, value in later.adam.items():
            dr.set_grad(value, mi.Float(gradients.get(name, np.ones(6, np.float32))))
        for optimizer in (plain, later):
            optimizer.schedule(3 + step)
            optimizer.step()
    assert np.abs(later.numpy(normals)).min() > 0
    np.testing.assert_allclose(later.numpy("means")[[0, 3]], plain.numpy("means")[[0, 3]], rtol=0, atol=1e-6)
    assert np.abs(later.numpy("means") - plain.numpy("means"))[[1, 2]].max() > 1e-5
    later.set_rows(plane, np.zeros(0, int), {})
    run(later, 1)
    assert np.isfinite(later.numpy("means")).all()


def test_training_goes_on_from_a_checkpoint_with_the_same_bits(tmp_path):
    straight = SplatOptimizer(random_model(6, 1, (0, 1, 3), rows=ROWS), JOINTLY)
    run(straight, 3)
    straight.drop_dog(mi.Bool([False, True, False, False, False, False]))
    resumed = SplatOptimizer(random_model(2, 1, seed=9), JOINTLY)
    resumed.restore(state_from_file(straight, tmp_path))
    for optimizer in (straight, resumed):
        run(optimizer, 3, seed=2)
    assert_same_state(resumed, straight)
    assert any("means" in name and "second_cut_normals" in name for name in straight.state())


def test_a_checkpoint_of_before_the_rule_begins_with_no_products():
    before, used, new = (SplatOptimizer(random_model(4, 0), rates) for rates in (RATES, JOINTLY, JOINTLY))
    for optimizer in (before, used):
        run(optimizer, 3)
    for optimizer in (used, new):
        optimizer.restore(before.state())
        run(optimizer, 2, seed=4)
    assert_same_state(used, new)


def test_a_number_without_any_gradient_stays_where_nothing_is_remembered():
    optimizer = SplatOptimizer(random_model(5, 0), replace(RATES, preconditioning=replace(RULE, memory=0.0)))
    before = optimizer.numpy("means")
    for step in range(2):
        optimizer.schedule(step)
        dr.set_grad(optimizer.adam["quats"], mi.Float(np.cos(np.arange(20))))
        optimizer.step()
    np.testing.assert_array_equal(optimizer.numpy("means"), before)
    assert np.isfinite(optimizer.numpy("quats")).all()


@pytest.mark.parametrize("damage", ["fewer primitives", "fewer entries", "unknown"])
def test_a_checkpoint_whose_products_do_not_fit_is_refused(damage):
    optimizer = SplatOptimizer(random_model(4, 0), JOINTLY)
    run(optimizer, 1)
    state = optimizer.state()
    (name,) = [name for name in state if name.startswith("products")]
    products = state.pop(name)
    name = "products of masks" if damage == "unknown" else name
    state[name] = {"fewer primitives": products[:, 1:], "fewer entries": products[1:]}.get(damage, products)
    with pytest.raises(ValueError, match=f'"{name.replace("+", ".")}" of the state does not fit its 4 primitives'):
        SplatOptimizer(random_model(4, 0), JOINTLY).restore(state)


@pytest.mark.parametrize(
    ("numbers", "problem"),
    [
        ({"start": -1}, "start is -1, expected a step"),
        ({"gain": 0.0}, "gain is 0.0, expected a positive number"),
        ({"damping": 0.0}, "damping is 0.0, expected a positive number"),
        ({"damping": np.inf}, "damping is inf, expected a positive number"),
        ({"memory": 1.0}, "memory is 1.0, expected a part below 1"),
        ({"memory": np.nan}, "memory is nan, expected a part below 1"),
    ],
)
def test_a_rule_with_a_number_out_of_range_is_refused(numbers, problem):
    with pytest.raises(ValueError, match=f"^Preconditioning: {problem}$"):
        replace(RULE, **numbers)


def test_the_start_scales_with_the_run_and_moves_with_its_beginning():
    rule = Preconditioning(18_000, gain=2.0)
    assert rule.scaled(7 / 30) == Preconditioning(4200, gain=2.0)
    assert rule.earlier(15_000) == Preconditioning(3000, gain=2.0) and rule.earlier(20_000).start == 0


def test_a_new_beginning_forgets_what_went_together():
    used, new = SplatOptimizer(random_model(5, 0), JOINTLY), SplatOptimizer(random_model(5, 0), JOINTLY)
    run(used, 3)
    for name in new.adam:
        new.assign(name, used.numpy(name))
    used.restart()
    for optimizer in (used, new):
        run(optimizer, 2, seed=4)
    assert_same(used.to_splats(), new.to_splats())


def test_what_forgets_its_moments_goes_together_with_nothing():
    """As opacities that are reset, or scales and rotations whose axes are written in another order."""
    optimizer = SplatOptimizer(random_model(4, 0), JOINTLY)
    optimizer.reset_moments("quats")  # before there is anything to forget
    run(optimizer, 3)
    before = products_of(optimizer)
    optimizer.reset_moments("quats")
    row, column = np.tril_indices(14)
    of_quats = np.isin(row, range(6, 10)) | np.isin(column, range(6, 10))
    prior = np.float32(PRIOR) * (row == column)[:, None]
    np.testing.assert_array_equal(products_of(optimizer), np.where(of_quats[:, None], prior, before))
    assert np.abs(before[of_quats & (row != column)]).max() > 0.01


def test_a_batch_leaves_as_little_of_what_was_as_its_views_one_after_the_other():
    """Once gradients are over, correlations stay, and their matrix falls with each step."""
    left = []
    for views in (1, 2):
        optimizer = SplatOptimizer(random_model(4, 0), replace(JOINTLY, batch_views=views))
        found = []
        for size in (0.1, *([0.0] * (4 // views))):
            for value in optimizer.adam.values():
                dr.set_grad(value, dr.opaque(mi.Float, size, dr.width(value)))
            optimizer.step()
            found.append(products_of(optimizer))
        left.append(found[-1] / found[0])
    np.testing.assert_allclose(left, RULE.memory**4, rtol=1e-5)


def test_linear_colours_step_by_the_slope_of_the_curve():
    """A lone gradient is Adam's, through the curve as well."""
    model = random_model(5, 0)
    jointly, adam = (SplatOptimizer(model, rates, SrgbLog()) for rates in (JOINTLY, RATES))
    for step in range(3):
        for optimizer in (jointly, adam):
            optimizer.schedule(step)
            dr.set_grad(optimizer.adam["sh_dc"], mi.Float(np.eye(3)[np.zeros(5, int)].ravel()))
            optimizer.step()
    moved = [optimizer.numpy("sh_dc") - model.sh_coeffs[:, 0] for optimizer in (jointly, adam)]
    assert np.abs(moved[1][:, 0]).min() > 1e-4
    np.testing.assert_allclose(moved[0][:, 0], RULE.gain * moved[1][:, 0], rtol=0.02)


def test_nothing_is_compiled_after_warm_up_as_rows_and_steps_change():
    optimizer = SplatOptimizer(random_model(50, 1, (1, 7, 11)), JOINTLY)

    def round_of(n: int, step: int) -> None:
        optimizer.rearrange(np.arange(n) % optimizer.n, np.arange(n) >= optimizer.n)
        alike(optimizer, step)

    assert_nothing_is_compiled(round_of)
