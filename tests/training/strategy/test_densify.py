"""Density control: who is cloned, split, removed, and that the cap holds; statistics against NumPy."""

import dataclasses

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from launches import KernelWatch
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.project import project
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.optimizer.learning_rates import LearningRates
from mi_dogsplat.training.optimizer.splat_optimizer import SplatOptimizer
from mi_dogsplat.training.strategy.densify import Densification, by_gradient, grow_and_remove
from mi_dogsplat.training.strategy.densify_stats import DensifyStats
from numpy.typing import ArrayLike
from stepped_optimizers import EXTENT, optimizer_of

RULE = Densification()
LATE = RULE.reset_every + 1
SMALL, LARGE, HUGE = 0.01, 0.1, 0.5  # world scales: cloned, split, removed late


def stats_of(gradients, radii: ArrayLike = 0.0) -> DensifyStats:
    """Statistics of two views with this mean gradient."""
    stats = DensifyStats.zeros(len(gradients))
    Float = type(stats.views)
    stats.gradient_sum = Float(2 * np.asarray(gradients, float))
    stats.views = Float(np.full(len(gradients), 2.0))
    stats.max_radius = Float(np.zeros(len(gradients)) + np.asarray(radii))
    return stats


def refined(optimizer, stats, rule=RULE, step=600, seed=0) -> tuple[dict, Splats, Splats]:
    """(counts, model before, model after)."""
    before = optimizer.to_splats()
    choice = by_gradient(rule, optimizer, stats, step, EXTENT)
    done = grow_and_remove(optimizer, choice, rule.split_divisor, np.random.default_rng(seed))
    return dataclasses.asdict(done), before, optimizer.to_splats()


def test_small_primitives_with_large_gradients_are_cloned():
    optimizer = optimizer_of([SMALL] * 4)
    counts, before, after = refined(optimizer, stats_of([0, 1e-3, 1e-4, 1e-3]))
    assert counts == {"cloned": 2, "split": 0, "removed": 0}
    expected = before.select([0, 1, 2, 3, 1, 3])
    for name in ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs"):
        np.testing.assert_array_equal(getattr(after, name), getattr(expected, name))


def test_large_primitives_with_large_gradients_give_way_to_two_samples_of_themselves():
    n = 4000
    optimizer = optimizer_of([LARGE] * n)
    for name in ("means", "log_scales", "quats"):
        optimizer.assign(name, np.repeat(optimizer.numpy(name)[:1], n, axis=0))
    counts, before, after = refined(optimizer, stats_of([1e-3] * (n - 1) + [0]))
    assert counts == {"cloned": 0, "split": n - 1, "removed": 0}
    assert after.n_splats == 2 * n - 1
    np.testing.assert_array_equal(after.means[0], before.means[n - 1])  # the one that was left alone
    np.testing.assert_allclose(after.scales[1:], np.tile(before.scales[0] / 1.6, (2 * n - 2, 1)), rtol=1e-5)
    np.testing.assert_array_equal(after.logit_opacities[1:n], before.logit_opacities[: n - 1])

    x, y, z, w = before.quats[0] / np.linalg.norm(before.quats[0])
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    standard = (after.means[1:] - before.means[0]) @ rotation / before.scales[0]  # should be N(0, I)
    np.testing.assert_allclose(standard.mean(0), 0, atol=0.06)
    np.testing.assert_allclose(np.cov(standard.T), np.eye(3), atol=0.08)


def test_survivors_keep_their_moments_and_new_rows_start_without():
    optimizer = optimizer_of([SMALL, LARGE, SMALL, SMALL], [0.5, 0.5, 0.001, 0.5])
    m = optimizer.state()["means.m"].reshape(-1, 3)
    counts, _, after = refined(optimizer, stats_of([1e-3, 1e-3, 1e-3, 0]))
    assert counts == {"cloned": 1, "split": 1, "removed": 1}
    assert after.n_splats == 5  # 0, 3, clone of 0, halves of 1
    state = optimizer.state()
    np.testing.assert_array_equal(state["means.m"].reshape(-1, 3), [*m[[0, 3]], *np.zeros((3, 3))])
    np.testing.assert_array_equal(state["means.v"].reshape(-1, 3), [*m[[0, 3]], *np.zeros((3, 3))])


def test_faint_primitives_are_removed_at_once_and_large_ones_only_late():
    scales, opacities = [SMALL, HUGE, SMALL, SMALL], [0.004, 0.5, 0.5, 0.006]
    rule = dataclasses.replace(RULE, max_screen_radius=20.0)
    for step, kept in ((600, [1, 2, 3]), (LATE, [3])):
        optimizer = optimizer_of(scales, opacities)
        counts, before, after = refined(optimizer, stats_of([0] * 4, [0, 0, 30, 10]), rule, step)
        np.testing.assert_array_equal(after.means, before.means[kept])
        assert counts["removed"] == 4 - len(kept)


def test_size_on_screen_is_no_reason_unless_asked_for():
    optimizer = optimizer_of([SMALL] * 2)
    assert refined(optimizer, stats_of([0, 0], 1e4), RULE, LATE)[2].n_splats == 2


def test_a_large_primitive_about_to_be_split_is_judged_by_its_halves():
    limit = RULE.max_world_scale * EXTENT
    optimizer = optimizer_of([1.5 * limit, 1.5 * limit, 1.7 * limit])
    counts, _, after = refined(optimizer, stats_of([1e-3, 0, 1e-3]), RULE, LATE)
    assert counts == {"cloned": 0, "split": 1, "removed": 2}
    assert after.n_splats == 2 and after.scales.max() < limit


def test_a_faint_model_keeps_its_best_primitive():
    optimizer = optimizer_of([SMALL] * 3, [0.001, 0.003, 0.002])
    _, before, after = refined(optimizer, stats_of([0] * 3))
    np.testing.assert_array_equal(after.means, before.means[[1]])


@pytest.mark.parametrize("cap", [1, 5, 7, 10, 13, 20, 40])
def test_the_cap_is_exact_at_every_moment_and_the_strongest_gradients_grow_first(cap, monkeypatch):
    rng = np.random.default_rng(cap)
    gradients = rng.uniform(0, 1e-3, 10)
    opacities = rng.uniform(0.1, 0.9, 10)
    opacities[:2] = 0.001
    optimizer = optimizer_of(rng.choice([SMALL, LARGE], 10), opacities)
    counted = []
    rearrange = SplatOptimizer.rearrange
    monkeypatch.setattr(SplatOptimizer, "rearrange", lambda *a: (rearrange(*a), counted.append(optimizer.n)))
    rule = dataclasses.replace(RULE, max_primitives=cap)
    counts, _, after = refined(optimizer, stats_of(gradients), rule)

    candidates = np.flatnonzero((gradients > RULE.gradient_threshold) & (opacities > 0.005))
    room = max(0, cap - 8)
    grown = counts["cloned"] + counts["split"]
    assert grown == min(room, len(candidates))
    assert after.n_splats == min(cap, 8 + len(candidates)) and all(n <= cap for n in counted)
    strongest = candidates[np.argsort(-gradients[candidates])][:grown]
    fresh_opacities = after.logit_opacities[after.n_splats - counts["cloned"] - 2 * counts["split"] :]
    old = np.log(opacities / (1 - opacities))
    np.testing.assert_allclose(np.unique(fresh_opacities), np.unique(old[strongest]), rtol=1e-5)


def one_after_the_other(scales, opacities, gradients, cap) -> tuple[set[int], set[int]]:
    """(who grows, who is removed) of a late refinement: what is too large is gone, unless there is room for its halves.
    """
    limit, rows = RULE.max_world_scale * EXTENT, range(len(scales))
    stays = {k for k in rows if opacities[k] >= RULE.min_opacity and scales[k] <= limit}
    grow, count = set(), len(stays)
    for k in sorted(rows, key=lambda k: -gradients[k]):
        divided = opacities[k] >= RULE.min_opacity and limit < scales[k] <= limit * RULE.split_divisor
        if gradients[k] > RULE.gradient_threshold and (k in stays or divided):
            count += 1 if k in stays else 2
            if count > cap:
                break
            grow.add(k)
    return grow, set(rows) - stays - grow


@pytest.mark.parametrize("cap", [10, 24, 25, 26, 30, 31, 40, 200])
def test_too_large_primitives_are_split_or_removed_at_the_cap_too(cap):
    rng, limit, n = np.random.default_rng(cap), RULE.max_world_scale * EXTENT, 40
    scales = rng.choice([SMALL, LARGE, 1.2 * limit, 1.5 * limit, 1.7 * limit], n)
    opacities, gradients = rng.choice([0.004, 0.3, 0.5, 0.9], n, p=[0.1, 0.3, 0.3, 0.3]), rng.uniform(0, 5e-4, n)
    rule, optimizer = dataclasses.replace(RULE, max_primitives=cap), optimizer_of(scales, opacities)
    choice = by_gradient(rule, optimizer, stats_of(gradients), LATE, EXTENT)
    grow, removed = one_after_the_other(scales, opacities, gradients, cap)
    assert set(np.flatnonzero(choice.grow)) == grow
    assert set(np.flatnonzero(choice.remove)) >= removed and np.sum(~choice.remove) + len(grow) <= cap
    if n - len(removed) <= cap:
        assert set(np.flatnonzero(choice.remove)) == removed


def test_a_model_of_too_large_primitives_is_not_removed_as_a_whole():
    limit = RULE.max_world_scale * EXTENT
    rule, optimizer = dataclasses.replace(RULE, max_primitives=1), optimizer_of([1.2 * limit] * 3, [0.2, 0.9, 0.4])
    _, before, after = refined(optimizer, stats_of([1e-3] * 3), rule, LATE)
    np.testing.assert_array_equal(after.means, before.means[[1]])


def test_a_start_above_the_cap_keeps_the_most_opaque():
    optimizer = optimizer_of([SMALL] * 5, [0.2, 0.9, 0.4, 0.8, 0.1])
    rule = dataclasses.replace(RULE, max_primitives=2)
    _, before, after = refined(optimizer, stats_of([1e-3] * 5), rule)
    np.testing.assert_array_equal(after.means, before.means[[1, 3]])


def test_refinement_repeats_with_the_seed():
    a, b, c = (refined(optimizer_of([LARGE] * 6), stats_of([1e-3] * 6), seed=s)[2].means for s in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, c)


def test_statistics_of_another_model_are_refused():
    with pytest.raises(ValueError, match="4 rows, the optimizer has 3"):
        refined(optimizer_of([SMALL] * 3), stats_of([0] * 4))


def test_an_opacity_reset_lowers_what_is_above_and_forgets_the_moments():
    optimizer = optimizer_of([SMALL] * 3, [0.9, 0.01, 0.003])
    RULE.reset_opacity(optimizer)
    np.testing.assert_allclose(optimizer.to_splats().opacities, [0.01, 0.01, 0.003], rtol=1e-5)
    state = optimizer.state()
    assert not state["logit_opacities.m"].any() and not state["logit_opacities.v"].any()
    assert state["means.m"].all()


def test_the_schedule_is_that_of_the_paper_at_30000_steps():
    rule = RULE.scaled(1)
    assert rule == RULE
    refinements = [step for step in range(30_001) if rule.refines(step)]
    assert refinements[0] == 500 and refinements[-1] == 14_900 and len(refinements) == 145
    assert [step for step in range(30_001) if rule.resets_opacity(step)] == [3000, 6000, 9000, 12_000]


@pytest.mark.parametrize("steps", [300, 1000, 2000, 7000, 60_000])
def test_a_run_of_any_length_refines_often_enough_and_resets_rarely(steps):
    rule = RULE.scaled(steps / 30_000)
    assert sum(rule.refines(step) for step in range(steps)) >= min(29, steps // 20)
    resets = [step for step in range(steps) if rule.resets_opacity(step)]
    assert len(resets) <= 4 and all(b - a >= 500 for a, b in zip(resets, resets[1:], strict=False))
    assert rule.stop == steps // 2


@pytest.mark.parametrize("steps", [3100, 4020, 7001, 30_000])
@pytest.mark.parametrize("stop", [8500, 9100, 15_000])
def test_opacities_have_come_back_when_growth_ends(steps, stop):
    rule = dataclasses.replace(RULE, stop=stop).scaled(steps / 30_000)
    resets = [step for step in range(steps) if rule.resets_opacity(step)]
    assert resets and rule.stop - resets[-1] >= 250  # they need about 200
    assert rule.stop - resets[-1] < 1.5 * rule.reset_every + 1  # no other is left out


# --- statistics ---


def view(width: int, height: int, z: float) -> DeviceCamera:
    w2c = affine(np.eye(3), (0, 0, z))
    return DeviceCamera.upload(Camera(w2c, 40.0, 40.0, width / 2, height / 2, width, height))


def scene(n: int) -> dict:
    """Primitives of which some are off the image or behind the camera; an oblique one is first."""
    rng = np.random.default_rng(n)
    means = rng.normal(size=(n, 3)) * (3, 3, 2)
    means[0] = 0
    log_scales = rng.normal(size=(n, 3)) * 0.3 - 1
    log_scales[0] = np.log([1.0, 0.01, 0.01])
    quats = rng.normal(size=(n, 4))
    quats[0] = 0, 0, np.sin(np.pi / 8), np.cos(np.pi / 8)  # 45 degrees about the viewing axis
    model = Splats(means, log_scales, quats, np.zeros(n), np.zeros((n, 1, 3)))
    optimizer = SplatOptimizer(model, LearningRates(1.0, 1))
    return optimizer.params


def test_statistics_average_over_the_views_that_saw_a_primitive():
    n, rng = 60, np.random.default_rng(0)
    params, stats = scene(n), DensifyStats.zeros(n)
    total, views, radius = np.zeros(n), np.zeros(n), np.zeros(n)
    for width, height, z in ((64, 48, 4.0), (33, 80, 2.0), (64, 48, 9.0)):
        projection = project(params, view(width, height, z), sh_degree=0)
        gx, gy = rng.normal(size=(2, n))
        stats.add(mi.Float(gx), mi.Float(gy), projection, width, height)

        ux, uy, vy = (np.float64(getattr(projection.kernels, k).numpy()) for k in ("ux", "uy", "vy"))
        rows = np.array([[ux * ux, ux * uy], [ux * uy, uy * uy + vy * vy]])
        conic = 2 * np.log(2) * rows.transpose(2, 0, 1)  # [N, 2, 2]
        r = 3 / np.sqrt(np.linalg.eigvalsh(conic)[:, 0])
        x, y = projection.x.numpy(), projection.y.numpy()
        seen = projection.visible.numpy() & (abs(x - width / 2) < width / 2 + r)
        seen &= abs(y - height / 2) < height / 2 + r
        total += np.where(seen, np.hypot(gx * width / 2, gy * height / 2), 0)
        views += seen
        radius = np.maximum(radius, np.where(seen, r, 0))
    assert 0 < np.mean(views == 0) and len(set(views)) == 4
    np.testing.assert_array_equal(stats.views.numpy(), views)
    np.testing.assert_allclose(stats.max_radius.numpy(), radius, rtol=1e-3)
    np.testing.assert_allclose(stats.mean_gradient(), total / np.maximum(views, 1), rtol=1e-4)


def test_gradients_that_are_not_finite_or_have_no_finite_square_do_not_count():
    n = 60
    projection, stats = project(scene(n), view(64, 48, 4.0), sh_degree=0), DensifyStats.zeros(n)
    gradient = np.ones((2, n), np.float32)
    gradient[:, 0], gradient[0, 1], gradient[1, 2] = np.nan, -np.inf, 1e30
    stats.add(mi.Float(gradient[0]), mi.Float(gradient[1]), projection, 64, 48)
    counted = stats.views.numpy() > 0
    counted[:3] = False
    np.testing.assert_array_equal(stats.mean_gradient() > 0, counted)
    assert stats.views.numpy()[0] == 1 and counted.any() and np.isfinite(stats.mean_gradient()).all()


def test_kept_rows_keep_their_statistics():
    stats = stats_of([1.0, 2.0, 3.0, 4.0], [5, 6, 7, 8])
    stats.follow(np.array([0, 2]))
    np.testing.assert_array_equal(stats.mean_gradient(), [1, 3])
    np.testing.assert_array_equal(stats.max_radius.numpy(), [5, 7])


def test_statistics_compile_nothing_when_views_and_counts_change():
    def collect(n: int, width: int, height: int):
        stats = DensifyStats.zeros(n)
        params, gradient = scene(n), dr.opaque(mi.Float, 1, n)
        for z in (4.0, 3.0):
            projection = project(params, view(width, height, z), sh_degree=0)
            stats.add(gradient, gradient, projection, width, height)
            dr.eval()

    with KernelWatch() as kernels:
        collect(20, 64, 48)
        kernels.forget()
        for n, width, height in ((30, 33, 48), (17, 64, 20), (80, 50, 50)):
            collect(n, width, height)
    assert kernels.launched and not kernels.new
