"""The pruning schedule: when it prunes and why, how many it leaves, and that the target is always met exactly."""

import dataclasses
import math
from collections.abc import Callable, Iterable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mi_dogsplat.training.milestones import scaled_milestone
from mi_dogsplat.training.strategy.scheduler import Decision, Progress, PruningRule, PruningScheduler, target_count

PAPER = PruningRule()
RELEASED = PruningRule(start=15_200, stop=25_200, beta=0.99, rounds=5)
EQUAL = PruningRule(division="equal", rounds=5)
PARTS = PruningRule(division=(1.0, 1.0, 1.0), rounds=3)
STUCK = 1.0  # an L1 that never falls


def scheduler_of(rule: PruningRule, n_start: int, n_target: int) -> PruningScheduler:
    """One whose first check has come."""
    scheduler = PruningScheduler(rule, Progress())
    scheduler.begin(n_start, n_target)
    return scheduler


def run(
    rule: PruningRule,
    n_start: int,
    n_target: int,
    l1: Callable[[int], float | None],
    steps: Iterable[int] = range(30_001),
) -> list[tuple[int, int, Decision]]:
    """(step, primitives before, decision) of every check."""
    scheduler, n, checks = scheduler_of(rule, n_start, n_target), n_start, []
    for step in steps:
        if scheduler.checks(step):
            decision = scheduler.decide(step, n, l1(step))
            checks.append((step, n, decision))
            n = decision.keep
    return checks


def prunes(checks: list[tuple[int, int, Decision]]) -> dict[int, tuple[int, int]]:
    """(before, after) by step."""
    return {step: (n, decision.keep) for step, n, decision in checks if decision.prune}


def falling(step: int) -> float:
    """An L1 that has always recovered."""
    return 0.9 ** (step / 500)


# --- when ---


def test_checks_come_every_500_steps_from_the_first_to_the_last_of_the_window():
    steps = [step for step, _, _ in run(PAPER, 40_000, 4000, lambda _: STUCK)]
    assert steps == list(range(15_000, 25_001, 500))


def test_the_first_check_prunes_whatever_the_error():
    for l1 in (0.0, STUCK, math.inf, math.nan):
        _, _, decision = run(PAPER, 40_000, 4000, lambda _, l1=l1: l1)[0]
        assert decision == Decision(True, 22_000, "first check")


def test_a_prune_waits_until_the_error_is_at_most_beta_times_that_before_the_previous_prune():
    l1 = {15_000: 0.02, 15_500: 0.03, 16_000: 0.0191, 16_500: 0.019, 17_000: 0.01806, 17_500: 0.01804}
    checks = run(PAPER, 40_000, 4000, lambda step: l1.get(step, STUCK), range(17_501))
    assert list(prunes(checks)) == [15_000, 16_500, 17_500]
    reasons = [decision.reason for _, _, decision in checks]
    assert reasons[1:4] == ["L1 0.03 > 0.95 x 0.02", "L1 0.0191 > 0.95 x 0.02", "L1 0.019 <= 0.95 x 0.02"]


def test_an_error_that_always_recovers_prunes_at_every_check():
    checks = run(PAPER, 40_000, 4000, falling)
    assert all(decision.prune for _, _, decision in checks)
    assert list(prunes(checks))[:3] == [15_000, 15_500, 16_000]


@pytest.mark.parametrize("l1", [STUCK, math.nan])
def test_2000_steps_without_a_prune_force_one(l1):
    checks = run(PAPER, 40_000, 4000, lambda _: l1)
    assert list(prunes(checks)) == [15_000, 17_000, 19_000, 21_000, 23_000, 25_000]
    forced = next(decision for step, _, decision in checks if step == 17_000)
    assert forced.reason == f"forced by 2000 steps since the last prune, L1 {l1:g} > 0.95 x {l1:g}"


def test_the_interval_of_a_forced_prune_starts_at_the_prune_before():
    checks = run(PAPER, 40_000, 4000, lambda step: 0.5 if step == 16_500 else STUCK)
    assert list(prunes(checks))[:4] == [15_000, 16_500, 18_500, 20_500]


def test_every_check_has_a_reason_and_a_refinement_keeps_all():
    checks = run(PAPER, 40_000, 4000, lambda step: math.sin(step) + 2)
    assert all(decision.reason and ";" not in decision.reason for _, _, decision in checks)
    assert all(decision.keep == n for _, n, decision in checks if not decision.prune)


def test_a_check_that_was_missed_is_made_up_for_without_shifting_the_others():
    steps = [step for step in range(15_003, 30_001) if not 17_000 <= step < 17_010]
    checks = run(PAPER, 40_000, 4000, lambda _: STUCK, steps)
    assert list(prunes(checks)) == [15_003, 17_010, 19_000, 21_000, 23_000, 25_000]
    assert [step for step, _, _ in checks][:3] == [15_003, 15_500, 16_000]


def test_a_schedule_that_starts_after_its_window_prunes_once_and_to_the_target():
    assert prunes(run(PAPER, 40_000, 4000, lambda _: STUCK, [26_000, 26_001])) == {26_000: (40_000, 4000)}


def test_where_every_check_prunes_nobody_asks_for_the_error():
    rule = PruningRule(stop=17_500, max_interval=500, rounds=5)
    assert not rule.compares and not rule.scaled(7 / 30).compares and PAPER.compares
    blind = run(rule, 40_000, 4000, lambda _: None)
    assert prunes(blind) == prunes(run(rule, 40_000, 4000, lambda _: STUCK))
    assert {decision.reason for _, _, decision in blind[1:-1]} == {"every check prunes"}
    with pytest.raises(ValueError, match="the rule compares, but there is no L1"):
        scheduler_of(PAPER, 100, 10).decide(15_000, 100, None)


def test_a_decision_without_a_check_is_refused():
    scheduler = scheduler_of(PAPER, 100, 10)
    for step in (14_999, 15_001):
        if step > 15_000:
            scheduler.decide(15_000, 100, STUCK)
        with pytest.raises(ValueError, match=f"step {step} is no check"):
            scheduler.decide(step, 100, STUCK)


# --- how many ---


def test_the_rates_of_the_released_code_at_a_target_of_a_tenth():
    checks = run(RELEASED, 1_000_000, 100_000, falling)
    rates = [1 - after / before for before, after in prunes(checks).values()]
    assert rates == pytest.approx([0.45, 0.409, 0.346, 0.265, 0.36], abs=5e-4)
    assert checks[-1][2].reason.endswith("round 5 meets the target")


def test_halving_removes_the_part_two_to_the_minus_t_in_round_t_and_the_rest_at_the_end():
    left = [after for _, after in prunes(run(PAPER, 40_000, 4000, lambda _: STUCK)).values()]
    assert left == [22_000, 13_000, 8500, 6250, 5125, 4000]
    assert run(PAPER, 40_000, 4000, lambda _: STUCK)[-1][2].reason == "the window closes"


def test_equal_division_removes_the_same_in_every_round():
    left = [after for _, after in prunes(run(EQUAL, 40_001, 4000, falling)).values()]
    assert left == [32_801, 25_601, 18_401, 11_201, 4000]


def test_parts_of_the_way_multiply_the_count_whatever_the_error():
    rule = PruningRule(15_000, 27_000, check_every=3000, max_interval=3000, division=(0.7, 0.1, 0.2), rounds=3)
    found = prunes(run(rule, 40_000, 4000, lambda _: STUCK))
    assert [after for _, after in found.values()] == [round(40_000 * 0.1**0.7), round(40_000 * 0.1**0.8), 4000]
    assert list(found) == [15_000, 18_000, 21_000]
    tenths = dataclasses.replace(rule, division=(7.0, 1.0, 2.0))
    assert prunes(run(tenths, 40_000, 4000, lambda _: STUCK)) == found
    late = prunes(run(PruningRule(15_000, 15_000, division=(2.0,), rounds=1), 40_000, 4000, falling))
    assert late == {15_000: (40_000, 4000)}


def test_nothing_is_measured_once_the_target_is_met():
    scheduler, n = scheduler_of(RELEASED, 1000, 100), 1000
    for step in range(15_200, 17_201, 500):
        assert scheduler.checks(step)
        n = scheduler.decide(step, n, falling(step)).keep
    assert n == 100 and scheduler.progress.finished
    assert not any(scheduler.checks(step) for step in range(17_201, 30_000))


@pytest.mark.parametrize("left", [90, 100])
def test_a_target_that_something_else_has_reached_ends_the_schedule(left):
    scheduler = scheduler_of(PAPER, 1000, 100)
    assert scheduler.decide(15_000, 1000, STUCK).keep == 550
    decision = scheduler.decide(15_500, left, STUCK)
    assert decision == Decision(False, left, f"{left} primitives are left, the target is 100")
    assert scheduler.progress.finished and not scheduler.checks(25_000)


@pytest.mark.parametrize("rule", [PAPER, RELEASED, EQUAL, PARTS])
@pytest.mark.parametrize(("n_start", "n_target"), [(2, 1), (3, 1), (3, 2), (5, 4), (10, 1)])
def test_tiny_models_lose_at_least_one_primitive_a_prune_and_end_at_the_target(rule, n_start, n_target):
    for l1 in (falling, lambda _: STUCK):
        steps = prunes(run(rule, n_start, n_target, l1))
        assert all(before > after for before, after in steps.values())
        assert list(steps.values())[-1][1] == n_target


# --- always ---


RULES = st.builds(
    lambda start, window, check, interval, beta, division, rounds: PruningRule(
        start, start + window, check, interval, beta, division, rounds if division == "equal" or rounds < 8 else None
    ),
    start=st.integers(0, 40),
    window=st.integers(0, 120),
    check=st.integers(1, 30),
    interval=st.integers(1, 60),
    beta=st.floats(0.5, 1.1),
    division=st.sampled_from(["halving", "equal"]),
    rounds=st.integers(1, 9),
)


@settings(deadline=None, max_examples=400)
@given(rule=RULES, counts=st.tuples(st.integers(1, 5000), st.integers(1, 5000)), data=st.data())
def test_whatever_the_errors_the_target_is_met_exactly_by_the_end_of_the_window(rule, counts, data):
    n_target, n_start = sorted(counts)
    n_start += n_start == n_target
    l1 = data.draw(st.lists(st.floats(0, 1) | st.just(math.nan), min_size=10, max_size=30))
    checks = run(rule, n_start, n_target, lambda step: l1[step % len(l1)], range(rule.stop + 2))
    steps = prunes(checks)
    assert checks[0][0] == rule.start and checks[0][2].prune
    assert list(steps.values())[-1][1] == n_target and checks[-1][0] <= rule.stop
    assert all(before > after >= n_target for before, after in steps.values())
    if rule.rounds is not None:
        assert len(steps) <= rule.rounds
        if n_start - n_target > 2**9:  # else rounding may reach the target before
            assert len(steps) == rule.rounds or list(steps)[-1] == rule.stop
    longest = -(-rule.max_interval // rule.check_every) * rule.check_every
    gaps = [b - a for a, b in zip(steps, list(steps)[1:], strict=False)]
    assert all(gap <= longest for gap in gaps)


@settings(deadline=None, max_examples=100)
@given(rule=RULES, cut=st.integers(0, 160), data=st.data())
def test_a_restored_schedule_decides_as_one_that_went_on(rule, cut, data):
    l1 = data.draw(st.lists(st.floats(0, 1), min_size=10, max_size=30))
    n, tail = 3000, []
    scheduler = scheduler_of(rule, n, 300)
    for step in range(rule.stop + 1):
        if step == cut:
            tail = [(PruningScheduler(rule, dataclasses.replace(scheduler.progress)), n)]
        for i, (other, count) in enumerate(tail):
            assert other.checks(step) == scheduler.checks(step)
            if other.checks(step):
                decision = other.decide(step, count, l1[step % len(l1)])
                tail[i] = other, decision.keep
                assert decision == scheduler.decide(step, n, l1[step % len(l1)])
                n = decision.keep
        if not tail and scheduler.checks(step):
            n = scheduler.decide(step, n, l1[step % len(l1)]).keep
    assert n == 300 and all(other.progress == scheduler.progress for other, _ in tail)


# --- runs of other lengths ---


@pytest.mark.parametrize("rule", [PAPER, RELEASED, EQUAL, dataclasses.replace(PAPER, start=0, stop=10_000)])
def test_a_run_of_any_length_completes_the_schedule(rule):
    for steps in (*range(1, 60), 300, 1000, 6960, 7000, 7020, 60_000):
        scaled = rule.scaled(steps / 30_000)
        done = list(prunes(run(scaled, 40_000, 4000, lambda _: STUCK, range(steps + 1))).values())
        assert done[-1][1] == 4000, steps
        assert len(done) >= 5 or steps < 30  # whose window has too few steps
        assert len(done) <= 7 or steps < 300  # whose checks are less than a step apart


def test_a_rule_scaled_by_one_is_the_same_and_one_for_7000_steps_has_the_same_checks():
    between_checks = PruningRule(max_interval=1700)
    for rule in (PAPER, RELEASED, between_checks):
        assert rule.scaled(1) == rule
    assert between_checks.scaled(2).max_interval == 3400  # the fourth check is forced, as ever
    scaled = PAPER.scaled(7000 / 30_000)
    assert (scaled.start, scaled.stop, scaled.check_every, scaled.max_interval) == (3500, 5833, 117, 468)


@pytest.mark.parametrize(
    ("factor", "every", "longest"),
    [(0.01, 5, 20), (0.0029, 1, 4), (0.002, 1, 4), (0.001, 1, 2), (0.0005, 1, 1), (0.0001, 1, 1)],
)
def test_where_checks_cannot_come_more_often_a_prune_is_forced_after_fewer_of_them(factor, every, longest):
    """2,000 steps of 30,000, in whole checks: four of them, or what of these is left where a check is a step."""
    rule = PAPER.scaled(factor)
    assert (rule.check_every, rule.max_interval) == (every, longest)


@pytest.mark.parametrize(("start", "stop"), [(15_000, 20_000), (15_000, 25_200), (16_000, 24_000)])
def test_a_window_of_two_checks_has_the_second_at_its_end_whatever_the_length_of_the_run(start, stop):
    """What else is due at that milestone, as a new optimizer, would else be a step apart."""
    for steps in (*range(1, 150), 2857, 2913, 7000):
        window = PruningRule(start, stop, stop - start, stop - start, division=(0.3, 0.7), rounds=2)
        rule = window.scaled(steps / 30_000)
        done = list(prunes(run(rule, 1000, 100, lambda _: STUCK, range(steps + 1))))
        assert done == sorted({rule.start, rule.stop}), steps
        assert rule.stop == scaled_milestone(stop, steps / 30_000)


# --- targets and wrong use ---


def test_a_target_below_one_is_a_ratio_and_any_other_a_count():
    assert [target_count(t, 1000) for t in (0.1, 0.0015, 1, 1.0, 999.0)] == [100, 2, 1, 1, 999]
    assert target_count(0.1, 40_321) == 4032


@pytest.mark.parametrize(
    ("target", "n", "words"),
    [
        (0.0, 100, "neither a ratio"),
        (-0.1, 100, "neither a ratio"),
        (math.nan, 100, "neither a ratio"),
        (math.inf, 100, "neither a ratio"),
        (3.5, 100, "neither a ratio"),
        (0.001, 100, "leaves none"),
        (100, 100, "100 primitives is not below the 100"),
        (5000, 100, "5,000 primitives is not below the 100"),
        (1, 1, "target of 1 primitive is not below the 1 that"),
        (0.999, 100, "100 primitives is not below the 100"),
        (0.5, 1, "of 1 primitive leaves none"),
        (1, 1, "not below the 1"),
    ],
)
def test_a_target_that_removes_nothing_or_leaves_nothing_says_so(target, n, words):
    with pytest.raises(ValueError, match=words):
        target_count(target, n)


@pytest.mark.parametrize(("n_start", "n_target"), [(10, 10), (10, 11), (10, 0), (1, 1), (0, 0)])
def test_a_scheduler_without_a_target_below_its_start_is_refused(n_start, n_target):
    with pytest.raises(ValueError, match=f"cannot prune {n_start} primitives to {n_target}"):
        scheduler_of(PAPER, n_start, n_target)


@pytest.mark.parametrize(
    "numbers",
    [
        {"start": -1},
        {"start": 10, "stop": 9},
        {"check_every": 0},
        {"max_interval": 0},
        {"division": "thirds"},
        {"division": "equal"},
        {"division": (0.5, 0.5)},
        {"division": (), "rounds": 0},
        {"division": (1.0, 0.0), "rounds": 2},
        {"rounds": 0},
    ],
)
def test_numbers_that_make_no_schedule_are_refused(numbers):
    with pytest.raises(ValueError, match="PruningRule"):
        PruningRule(**numbers)
