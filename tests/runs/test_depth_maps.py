"""A run says what its depth maps were taken for, and how many views have them."""

import json

import numpy as np
import pytest
import tiny_data
from html_pages import parsed, section, words
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import Observations
from mi_dogsplat.inspection.info import describe
from mi_dogsplat.runs import run
from mi_dogsplat.training.config import TrainConfig


def trained(tmp_path, monkeypatch, observed: bool) -> tuple[dict, list[str], list[str]]:
    """Metrics, what is told before the first step, and the lines of ``dogsplat info``, of a run without the map of one
    view; with the maps of inverse depth if the data say which points the views see."""
    data = tiny_data.write_tiny_data(tmp_path / "data")
    dataset = load_dataset(data)
    rng, points = np.random.default_rng(0), []
    (tmp_path / "depth").mkdir()
    for k, view in enumerate(dataset.train[1:]):
        depth = rng.uniform(1, 3, (view.camera.height, view.camera.width))
        np.save(tmp_path / "depth" / f"{view.name}.npy", 0.3 + k + 1 / depth if observed else depth)
        rows, columns = (rng.integers(0, most, 30) for most in depth.shape)
        pixels = np.column_stack([columns, rows]) + 0.5
        dataset.observations[view.name] = Observations(pixels, 30 * k + np.arange(30))
        points.append(view.camera.unproject(pixels, depth[rows, columns]))
    if observed:
        dataset.points = np.concatenate(points).astype(np.float32)
        dataset.point_colors = np.full_like(dataset.points, 0.5)
    else:
        dataset.observations.clear()
    monkeypatch.setattr(run, "load_dataset", lambda *args, **kwargs: dataset)
    settings = {"steps": 2, "preset": "3dgs", "max_primitives": 400, "depths": str(tmp_path / "depth")}
    notes: list[str] = []
    out = tmp_path / "run"
    run.train(TrainConfig(str(data), **settings), out, lambda row: notes.extend(row.get("notes", ())))
    return json.loads((out / "metrics.json").read_text()), notes, describe(out)


@pytest.mark.parametrize("observed", [False, True])
def test_a_run_tells_of_its_depth_maps(tmp_path, monkeypatch, observed):
    metrics, notes, lines = trained(tmp_path, monkeypatch, observed)
    folder, n = tmp_path / "depth", metrics["depths"]["views"]
    assert metrics["depths"] | {"error": 0} == {"views": n, "used": n - 1, "inverse": observed, "error": 0}
    part = section(parsed((tmp_path / "run" / "report.html").read_text()), "Depth maps")
    assert part is not None and f"Of {folder}: {n - 1} of {n} training views, " in words(part)
    (told,) = [line for line in lines if line.startswith("  depth maps")]
    if observed:
        assert notes[1:] == [
            f"{folder}: the maps hold inverse depth, by the sparse points of {n - 1} views; "
            "the median error at these is 0.0 %"
        ]
        assert metrics["depths"]["error"] < 1e-5
        assert told.endswith(f"{n - 1} of {n} training views, inverse depth, median error 0.0 % at the sparse points")
    else:
        assert len(notes) == 1 and metrics["depths"]["error"] is None
        assert told.endswith(f"{n - 1} of {n} training views, depth")
