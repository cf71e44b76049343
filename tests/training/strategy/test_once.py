"""What happens once in a training: at its step or as soon after it as can be, and not again after a checkpoint."""

from types import SimpleNamespace
from typing import Any

import pytest
from mi_dogsplat.training.given_rows import GIVEN
from mi_dogsplat.training.strategy.dog_control import DogActivation, DogRule
from mi_dogsplat.training.strategy.once import Once
from mi_dogsplat.training.strategy.row_activation import RowActivation, RowRule
from mi_dogsplat.training.strategy.strategy import arrays_of, restore_fields


class Said(Once):
    @property
    def start(self) -> int:
        return 3

    def act(self, t):
        return [t.step_count]


def told(begun: int, saved: dict | None = None) -> tuple[list, Any]:
    """What a run of five steps tells, which begins with so many; and its state."""
    strategy, t = Said(), SimpleNamespace(step_count=begun)
    state = strategy.new_state(t)  # type: ignore[arg-type]
    if saved is not None:
        restore_fields(state, saved)
    found = strategy.begin(t, state)  # type: ignore[arg-type]
    for t.step_count in range(begun + 1, 6):
        found += strategy.after_step(t, state)  # type: ignore[arg-type]
    return found, state


@pytest.mark.parametrize("begun, at", [(0, 3), (2, 3), (3, 3), (4, 4)])
def test_it_happens_once_at_its_step_or_as_soon_after_it_as_can_be(begun, at):
    assert told(begun)[0] == [at]


def test_what_has_happened_before_a_checkpoint_does_not_happen_again():
    assert told(2, arrays_of(told(0)[1]))[0] == []


def test_states_have_the_names_that_checkpoints_of_earlier_versions_have():
    strategies = DogActivation(DogRule(start=7)), *(RowActivation(rows, RowRule(start=7)) for rows in GIVEN.values())
    for strategy in strategies:
        assert strategy.start == 7
        assert list(arrays_of(strategy.new_state(SimpleNamespace()))) == ["done"]  # type: ignore[arg-type]
    words = "dog", "slope", "curvature", "cut", "secondcut", "shift"
    assert [strategy.name for strategy in strategies] == [f"{word}activation" for word in words]
