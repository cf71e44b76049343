"""How Improved-GS grows, and when it removes what does not recover."""

import numpy as np
import pytest
from mi_dogsplat.compare.rivals import improved_gs


def test_recovery_aware_removal_comes_after_the_resets_however_short_the_run():
    for steps in (30_000, 7000, 3000, 1500):
        recipe = improved_gs.RECIPE.scaled(steps)
        (removal,) = (part for part in recipe.also if isinstance(part, improved_gs.RecoveryAware))
        resets = [step for step in range(steps) if recipe.densification.resets_opacity(step)][:2]
        assert resets and (steps < 30_000 or removal.after_resets == (3300, 6300))
        for reset, after in zip(resets, removal.after_resets, strict=False):  # a short run has a single reset
            assert after - reset == pytest.approx(0.1 * resets[0], abs=1)


@pytest.mark.parametrize(("steps", "removals"), [(600, 0), (1500, 1), (2500, 2)])
def test_recovery_aware_removal_ends_with_densification_after_which_nothing_grows(steps, removals):
    recipe = improved_gs.RECIPE.scaled(steps)
    (removal,) = (part for part in recipe.also if isinstance(part, improved_gs.RecoveryAware))
    assert len(removal.after_resets) == removals
    assert all(step < recipe.densification.stop for step in removal.after_resets)


def test_improved_gs_grows_along_a_square_root_and_splits_all(trainer_of):
    trainer = trainer_of(improved_gs.RECIPE, 3000, target=200)
    rule = trainer.recipe.densification
    for _ in range(rule.start):
        trainer.step()
    stats = trainer.states["densification"]
    first, last = -(-rule.start // rule.every), (rule.stop - 1) // rule.every
    trainer.step_count = rule.every * (first + (last - first) // 4)
    progress = ((last - first) // 4) / (last - first)
    choice = improved_gs.EdgeGrowth()(trainer, rule, stats)
    may = ~choice.remove & (improved_gs.edge_scores(trainer) > 0)
    room = round(200 * np.sqrt(progress * (14_900 - 500) / (14_500 - 500))) - int((~choice.remove).sum())
    assert choice.grow.sum() == max(0, min(room, may.sum())) and not choice.small.any()
    assert (may | ~choice.grow).all()


def test_improved_gs_has_room_for_all_at_step_14500_and_goes_by_gradients_after_it(trainer_of, monkeypatch):
    trainer = trainer_of(improved_gs.RECIPE, 3000, target=60)
    rule, n = improved_gs.DENSIFICATION, trainer.optimizer.n
    stats, by_edges = trainer.states["densification"], np.ones(n)
    stats.views += 1
    stats.gradient_sum += 1
    asked = []
    monkeypatch.setattr(improved_gs, "edge_scores", lambda t: asked.append(t.step_count) or by_edges)
    for step in (600, 5000, 12_000, 14_000, 14_400, 14_500, 14_600, 14_900):
        trainer.step_count = step
        budget = min(60.0, np.sqrt((step - 500) / 14_000) * 60)
        grown = improved_gs.EdgeGrowth()(trainer, rule, stats).grow.sum()
        assert grown == max(0, round(budget) - n), step
    assert max(asked) == 14_500 and len(asked) == 6
