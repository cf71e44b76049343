"""The seam of training: every hook at its place, state in checkpoints, rows that move, and what is refused."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from happenings import history_of, records
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.runs import run
from mi_dogsplat.runs.checkpoint import load_checkpoint, save_checkpoint
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scores.score import ScoreRule
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.events import Dropped, Event
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.strategy import Seen, Strategy, Training
from mi_dogsplat.training.train import Trainer

STEPS = 30


def config_of(data: Path, **changes) -> TrainConfig:
    base: dict[str, Any] = {"preset": "3dgs", "steps": STEPS, "sh_degree": 1, "max_primitives": 100, "log_every": 5}
    return TrainConfig(str(data), **(base | changes))


def trainer_of(data: Path, *strategies: Strategy, **changes) -> Trainer:
    config = config_of(data, **changes)
    return Trainer(config, load_dataset(data), replace(RECIPES[config.preset], also=strategies))


@dataclass
class Calls:
    """State of ``Recorder``."""

    steps: int = 0
    names: Any = None
    rows: Any = None


@dataclass(frozen=True)
class Recorder(Strategy[Calls]):
    """Writes down what it is called for."""

    def new_state(self, t: Training) -> Calls:
        return Calls(names=np.zeros(0, "U20"), rows=np.arange(t.optimizer.n))

    def called(self, state: Calls, name: str) -> None:
        state.names = np.append(state.names, name)

    def begin(self, t: Training, state: Calls) -> list[Event]:
        self.called(state, "begin")
        return []

    def before_step(self, t: Training, state: Calls) -> None:
        self.called(state, "before_step")

    def collects(self, t: Training, state: Calls) -> bool:
        return True

    def params(self, t: Training, state: Calls, params: dict) -> dict:
        self.called(state, "params")
        return params | {"mine": mi.UInt32(t.step_count)}

    def after_backward(self, t: Training, state: Calls, seen: Seen) -> None:
        self.called(state, "after_backward")
        assert int(seen.params["mine"][0]) == t.step_count == state.steps and seen.by_center
        assert dr.width(seen.by_center[0]) == t.optimizer.n
        assert np.abs(dr.grad(t.optimizer.params["means"]).numpy()).max() > 0
        assert dr.width(seen.planes[0]) == seen.camera.width * seen.camera.height == dr.width(seen.gradient[0])

    def after_step(self, t: Training, state: Calls) -> list[Event]:
        self.called(state, "after_step")
        state.steps += 1
        assert t.step_count == state.steps
        return [Dropped(0, "of mine")] if t.step_count == 3 else []

    def scores(self, t: Training, state: Calls, rest: Callable[[], np.ndarray]) -> np.ndarray:
        self.called(state, "scores")
        return rest()

    def rearranged(self, state: Calls, index: np.ndarray, fresh: np.ndarray) -> None:
        state.rows = np.where(fresh, -1, state.rows[index])


def test_hooks_come_in_their_order_and_their_events_in_the_history(data):
    trainer = trainer_of(data, Recorder())
    rows = list(run_to_end(trainer, until=3))
    each = ["before_step", "params", "after_backward", "after_step"]
    assert trainer.states["recorder"].names.tolist() == ["begin", *each * 3]
    assert rows[-1]["event"] == "dropped 0 of mine"
    assert rows[-1]["events"] == [{"kind": "dropped", "count": 0, "what": "of mine"}]


def test_what_a_strategy_holds_per_primitive_follows_every_change_of_rows(data):
    trainer = trainer_of(data, Recorder(), preset="ours", target=0.4)
    before = trainer.optimizer.numpy("means")
    rows = list(run_to_end(trainer))
    state = trainer.states["recorder"]
    assert len(state.rows) == trainer.optimizer.n < max(row["n"] for row in rows) and (state.rows >= 0).any()
    prunes = records(rows, "pruned")
    assert state.names.tolist().count("scores") == len(prunes) > 0
    survivors = state.rows >= 0  # not clones or halves: they have hardly moved
    moved = np.abs(trainer.optimizer.numpy("means")[survivors] - before[state.rows[survivors]]).max()
    assert moved < np.abs(before).max() / 2


def test_a_score_of_a_strategy_decides_who_is_pruned(data):
    @dataclass(frozen=True)
    class Backwards(Strategy[None]):
        def scores(self, t: Training, state: None, rest: Callable[[], np.ndarray]) -> np.ndarray:
            return -rest()

    score = ScoreRule("opacity")  # has the same bits whenever it is asked
    trainer = trainer_of(data, Backwards(), preset="ours")
    np.testing.assert_array_equal(trainer.scores(score), -trainer.importance(score))


def test_a_strategy_that_does_nothing_changes_no_bit(data, ordered):
    @dataclass(frozen=True)
    class Idle(Strategy[None]):
        pass

    plain, idle = trainer_of(data), trainer_of(data, Idle())
    for trainer in (plain, idle):
        for _ in range(8):
            trainer.step()
    expected, got = plain.optimizer.to_splats(), idle.optimizer.to_splats()
    np.testing.assert_array_equal(got.means, expected.means)
    assert plain.rng.bit_generator.state == idle.rng.bit_generator.state


def test_the_state_of_a_strategy_stands_in_the_checkpoint_by_its_name_and_goes_on(data):
    first, second = trainer_of(data, Recorder()), trainer_of(data, Recorder())
    for _ in range(7):
        first.step()
    state = first.state()
    assert state["recorder.steps"] == 7 and {"recorder.names", "recorder.rows"} < state.keys()
    second.restore(state)
    restored = second.states["recorder"]
    assert restored.steps == 7 and restored.names.tolist() == first.states["recorder"].names.tolist()
    second.step()  # its asserts see that it goes on at step 7
    incomplete = {name: value for name, value in state.items() if name != "recorder.steps"}
    with pytest.raises(KeyError, match="steps"):
        second.restore(incomplete)


def test_a_state_that_the_checkpoint_holds_is_not_made_anew(data, monkeypatch):
    """For some of the rivals that is a transform of every photograph."""
    first, second = trainer_of(data, Recorder()), trainer_of(data, Recorder())
    first.step()
    made, new_state = [], Recorder.new_state
    monkeypatch.setattr(Recorder, "new_state", lambda self, t: made.append(t) or new_state(self, t))
    second.restore(first.state())
    assert not made and second.states["recorder"].steps == 1
    second.restore(trainer_of(data).state())
    assert made == [second] and second.states["recorder"].steps == 0


def test_a_state_without_the_strategy_begins_it(data):
    shared, trainer = trainer_of(data), trainer_of(data, Recorder())
    shared.step()
    trainer.restore(shared.state())
    assert trainer.step_count == 1 and trainer.states["recorder"].steps == 0


def test_two_strategies_of_one_name_are_refused(data):
    with pytest.raises(ValueError, match='two strategies have the name "recorder"'):
        trainer_of(data, Recorder(), Recorder())


def test_a_checkpoint_of_an_earlier_version_is_refused_in_one_line(data, tmp_path):
    config = config_of(data, steps=10)
    run.train(config, tmp_path)
    path = tmp_path / run.CHECKPOINT
    state = load_checkpoint(path)
    del state["format"]
    save_checkpoint(path, state)
    uses: tuple[dict[str, Any], ...] = ({"resume": True}, {"start": path})
    for arguments in uses:
        with pytest.raises(DataError, match=r"state\.npz: .*another version of mi_dogsplat.*; remove it") as error:
            run.train(config, tmp_path, **arguments)
        assert "\n" not in str(error.value)


def test_the_history_keeps_text_and_columns_beside_the_records(data, tmp_path):
    run.train(config_of(data, preset="paper", target=0.4), tmp_path)
    rows = history_of(tmp_path)
    pruned = [(row, e) for row in rows for e in row.get("events", ()) if e["kind"] == "pruned"]
    kinds = {event["kind"] for row in rows for event in row.get("events", ())}
    assert len(pruned) >= 2 and {"densified", "dog_activated"} < kinds
    for row, event in pruned:
        assert (row["pruned_from"], row["pruned_to"]) == (event["before"], event["after"])
        assert row["train_l1"] == event["train_l1"]
        assert f"prune {event['before']} -> {event['after']}: {event['reason']}" in row["event"]
    assert all(("event" in row) == ("events" in row) for row in rows)
