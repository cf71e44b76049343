"""How Taming-3DGS scores, shares and fills its room, by independent brute force."""

from dataclasses import replace

import numpy as np
from mi_dogsplat import reference
from mi_dogsplat.compare.rivals import taming
from mi_dogsplat.compare.rivals.taming import VIEWS, Taming, importance, parabola, saliency
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.render.picture import as_taken
from mi_dogsplat.scene.appearance import Appearance, device_of
from mi_dogsplat.training.events import Densified


def test_taming_grows_along_the_parabola_of_the_paper():
    S, D, N = 1000, 9000, 145
    counts = [parabola(x / N, S, S + D) for x in range(N + 1)]
    assert counts == [round(-D * (x / N) ** 2 + 2 * D * (x / N) + S) for x in range(N + 1)]
    assert counts[0] == S and counts[-1] == S + D


def test_taming_adds_up_the_terms_of_brute_force(trainer_of):
    trainer = trainer_of(taming.RECIPE, 3000)
    for _ in range(12):  # some gradients, and no refinement yet
        trainer.step()
    rng = np.random.default_rng(3)
    long = np.log([0.1, 0.01, 0.01]) + rng.uniform(-0.2, 0.2, (trainer.optimizer.n, 3))
    trainer.optimizer.assign("log_scales", long)
    trainer.optimizer.assign("quats", rng.normal(size=(trainer.optimizer.n, 4)))
    splats, dataset, stats = trainer.optimizer.to_splats(), trainer.dataset, trainer.states["densification"]
    gradient, n = stats.mean_gradient().astype(np.float64), trainer.optimizer.n
    trainer.rng = np.random.default_rng(5)
    got = importance(trainer, stats)
    chosen = np.random.default_rng(5).permutation(len(dataset.train))[:VIEWS]

    def scaled(values, weight):
        return weight * values / np.median(values[values > 0])

    of_model = scaled(gradient, 25) + scaled(trainer.optimizer.to_splats().opacities, 100)
    of_model += scaled(np.exp(splats.log_scales.astype(float)).prod(1), 25)
    expected = np.zeros(n)
    for view in (dataset.train[int(k)] for k in chosen):
        options = {"sh_degree": trainer.active_sh_degree}
        weight, T = reference_score.weights(splats, view.camera, **options)
        picture = np.clip(reference.render(splats, view.camera, **options)[0], 0, 1)
        error = np.abs(picture - view.image).mean(-1)
        e, shown = saliency(error, view.image), (T > 0).any((1, 2))
        projection = reference.project(splats, view.camera, **options)
        radius = np.sqrt(np.linalg.eigvalsh(projection.cov2d[:, [0, 1, 1, 2]].reshape(-1, 2, 2))[:, 1])
        total = of_model + scaled(projection.depths * shown, 5) + scaled(radius * shown, 10)
        total += scaled((T > 0).sum((1, 2)), 0.1) + scaled(weight.sum((1, 2)), 50)
        total += scaled((e * weight).sum((1, 2)), 10)
        expected += (0.8 * error.mean() + 0.2 * (1 - brute_force_ssim(picture, view.image))) * total * shown
    np.testing.assert_allclose(got, expected, rtol=1e-3)


def test_the_loss_of_a_view_is_that_of_the_model_as_its_camera_took_it(trainer_of, monkeypatch):
    trainer = trainer_of(taming.RECIPE, 3000, appearance=True)
    names, camera = [view.name for view in trainer.dataset.train], trainer.dataset.train[0].camera
    gains = np.random.default_rng(0).uniform(-1.5, 0, (len(names), 3))
    learned = Appearance(names, [device_of(camera)], gains, np.array([[-0.3, -0.2]]))

    def taken(view, background):
        return as_taken(trainer.picture(view), view.camera, learned.numbers(view.camera, view.name)).color

    monkeypatch.setattr(taming, "photograph", taken)
    stats = trainer.states["densification"]
    assert importance(trainer, stats).max() > 1  # nothing is learned yet
    monkeypatch.setattr(trainer, "appearance", lambda: learned)
    np.testing.assert_allclose(importance(trainer, stats), 0, atol=1e-3)


def brute_force_ssim(a: np.ndarray, b: np.ndarray) -> float:
    """11 x 11 windows, sigma 1.5, zeros outside, by sums over the offsets."""
    g = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
    window = np.outer(g, g) / np.outer(g, g).sum()

    def mean(x: np.ndarray) -> np.ndarray:
        padded = np.pad(x, ((5, 5), (5, 5), (0, 0)))
        shifted = [padded[i : i + x.shape[0], j : j + x.shape[1]] * window[i, j] for i in range(11) for j in range(11)]
        return np.sum(shifted, axis=0)

    A, B = mean(a), mean(b)
    cross, squares = mean(a * b) - A * B, mean(a * a) - A**2 + mean(b * b) - B**2
    return float(((2 * A * B + 1e-4) * (2 * cross + 9e-4) / ((A**2 + B**2 + 1e-4) * (squares + 9e-4))).mean())


def test_the_edges_are_laplacians_of_grey_levels_and_each_part_of_the_saliency_goes_up_to_50():
    rng = np.random.default_rng(0)
    photograph, error = rng.integers(0, 256, (9, 12, 1)).repeat(3, axis=2) / 255, np.zeros((9, 12))
    error[1, 1] = 0.3
    grey = np.round(photograph[..., 0] * 255)
    laplacian = np.zeros((9, 12))
    for y in range(1, 8):
        for x in range(1, 11):
            laplacian[y, x] = np.clip(9 * grey[y, x] - grey[y - 1 : y + 2, x - 1 : x + 2].sum(), 0, 255)
    inside = (slice(1, 8), slice(1, 11))
    e = saliency(error, photograph)
    np.testing.assert_allclose(e[inside], 50 * laplacian[inside] / 255 + 50 * (error[inside] > 0), atol=0.2)


def test_taming_shares_the_room_among_clones_and_splits_above_the_threshold_and_fills_it_at_the_end(trainer_of):
    trainer = trainer_of(taming.RECIPE, 3000)
    rule = replace(trainer.recipe.densification, clone_scale=float(np.median(largest(trainer)) / trainer.extent))
    for _ in range(rule.start):
        trainer.step()
    logits = trainer.optimizer.numpy("logit_opacities")
    logits[:7] = -9
    trainer.optimizer.assign("logit_opacities", logits)
    stats = trainer.states["densification"]
    gradient = stats.mean_gradient()
    few = replace(rule, gradient_threshold=float(np.sort(gradient)[-12]))
    trainer.step_count = 12 * rule.every
    choice = Taming()(trainer, few, stats)
    assert choice.remove[:7].all() and not (choice.grow & choice.remove).any()
    assert set(np.flatnonzero(choice.grow)) <= set(np.flatnonzero(gradient >= few.gradient_threshold))
    trainer.step_count = 0  # little room: less than there are candidates
    room = Taming().budget(trainer, rule) - int((~choice.remove).sum())
    choice = Taming()(trainer, rule, stats)
    may = ~choice.remove & (gradient >= rule.gradient_threshold)
    clones = int((choice.grow & choice.small).sum())
    assert choice.grow.sum() == min(room, may.sum())
    assert clones == round(min(room, may.sum()) * (may & choice.small).sum() / may.sum())
    trainer.step_count = (rule.stop - 1) // rule.every * rule.every
    alive = int((~Taming()(trainer, few, stats).remove).sum())
    next(e for e in few.after_step(trainer, stats) if isinstance(e, Densified))
    assert trainer.optimizer.n == min(90, 2 * alive)  # each grows once, those below the threshold too


def largest(trainer) -> np.ndarray:
    return np.exp(trainer.optimizer.numpy("log_scales").max(1))
