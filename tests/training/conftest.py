"""What tests of trainings share."""

import pytest
from mi_dogsplat.training import train as train_module
from mi_dogsplat.training.strategy.pose_refinement import PoseRefinement


@pytest.fixture
def at_once(monkeypatch) -> None:
    """Poses are refined from the first step on."""
    monkeypatch.setattr(train_module, "PoseRefinement", lambda: PoseRefinement(start=0))
