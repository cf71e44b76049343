"""Methods that grow by what photographs show look only at what their masks leave."""

from types import SimpleNamespace

import numpy as np
import pytest
from mi_dogsplat.compare.rivals import improved_gs, taming
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.render.picture import photograph
from PIL import Image


@pytest.fixture
def masks(data, tmp_path) -> str:
    """Black on the left half of each photograph."""
    for view in load_dataset(str(data), 1).train:
        mask = np.full((view.camera.height, view.camera.width), 255, np.uint8)
        mask[:, : view.camera.width // 2] = 0
        Image.fromarray(mask).save(tmp_path / f"{view.name}.png")
    return str(tmp_path)


def with_stripes(view, background: float) -> np.ndarray:
    """The photograph with stripes in its left half, but for two columns: an edge is found in 3 x 3 pixels."""
    image = np.array(photograph(view, background))
    image[:, : view.camera.width // 2 - 2 : 4] = 0.5
    return image


def scores(trainer, method) -> np.ndarray:
    trainer.rng = np.random.default_rng(0)
    if method == "improved_gs":
        return improved_gs.edge_scores(trainer)
    n = trainer.optimizer.n
    return taming.importance(trainer, SimpleNamespace(mean_gradient=lambda: np.ones(n)))  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["improved_gs", "taming"])
def test_photographs_count_where_masks_leave_them(trainer_of, masks, method, monkeypatch):
    trainer = trainer_of(improved_gs.RECIPE, 3000, masks=masks)
    before = scores(trainer, method)
    module = {"improved_gs": improved_gs, "taming": taming}[method]
    monkeypatch.setattr(module, "photograph", with_stripes)
    after = scores(trainer, method)
    assert before.any()
    np.testing.assert_allclose(after, before, rtol=1e-5)
