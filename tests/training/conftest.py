"""What tests of trainings share."""

import pytest
from mi_dogsplat.training import resolve
from mi_dogsplat.training.strategy.pose_refinement import PoseRefinement


@pytest.fixture
def at_once(monkeypatch) -> None:
    """Poses are refined from the first step on."""
    monkeypatch.setattr(resolve, "PoseRefinement", lambda: PoseRefinement(start=0))
