"""The tutorials run, come out as they say, and are saved with the outputs of the cells that they have.

They run as they stand, but for samples of pictures that nothing is claimed about (``FEWER``).
"""

import ast
import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[2] / "tutorials"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
MOST_BYTES = 1_500_000  # of all notebooks, pictures included
OF_OTHER_RUNS = {"posed", "refined", "appearance.json", "masked.png"}  # of plain images, or with flags
# samples of pictures that nothing is claimed about, and how many they get here
FEWER = {"spp=64": "spp=2"}
# what each promises in words, run as its last cell
CLAIMS = {
    "1_render_and_differentiate": """
        assert abs(x - 0.35) < 0.01 and abs(y + 0.25) < 0.01 and abs(angle - 25) < 0.5
        error = {name: float(dr.mean(dr.square(image - targets[view])).array[0])
                 for name, image, view in (("grey", grey, 0), ("seen", seen, 0), ("behind", behind, unseen))}
        assert error["seen"] < 0.05 * error["grey"] and error["behind"] > 5 * error["seen"]
    """,
    "2_from_photographs_to_a_compact_model": """
        assert metrics["n"] <= 1000 < baseline["n"] <= 4000 and metrics["n_dog"] > 0.8 * metrics["n"]
        assert metrics["bytes"] < baseline["bytes"] / 3
        assert metrics["test"]["psnr"] > 21 and abs(metrics["test"]["psnr"] - baseline["test"]["psnr"]) < 1.5
        assert max(row["n"] for row in rows) == 4000 and "reset opacity" not in str(rows)
    """,
    "3_a_model_among_meshes": """
        covered = values["count.I"] > 0
        assert 0.1 < covered.mean() < 0.6 and (values["index.I"][~covered] == -1).all()
        assert (values["depth.Z"][-20:] > 0).all() and not covered[-20:].all()  # the table, where no splat is
        assert np.ptp(derivative) > 1 and np.abs(derivative[:20]).max() == 0  # the sky above does not move
        assert np.abs(both.numpy() - meshes.numpy())[covered].mean() > 0.05
    """,
}


def read(path: Path) -> nbformat.NotebookNode:
    return nbformat.read(path, as_version=4)


def code_cells(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def kinds_of_output(cell: nbformat.NotebookNode) -> list[str]:
    """What a cell shows, without the text that its outputs hold: that differs from machine to machine."""
    return [out.get("name") or "/".join(sorted(out["data"])) for out in cell.outputs]


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_tutorial_runs_and_comes_out_as_it_says(path, tmp_path, monkeypatch):
    for name in ("TMPDIR", "IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "MPLCONFIGDIR"):  # nothing of the user's is used
        (tmp_path / name).mkdir()
        monkeypatch.setenv(name, str(tmp_path / name))
    saved, fresh = read(path), read(path)
    lines = [line.strip() for line in CLAIMS[path.stem].strip().splitlines()]
    for cell in code_cells(fresh):
        for samples, fewer in FEWER.items():
            cell.source = cell.source.replace(samples, fewer)
    fresh.cells.append(nbformat.v4.new_code_cell("\n".join(lines)))
    NotebookClient(fresh, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(FOLDER)}}).execute()
    for before, now in zip(code_cells(saved), code_cells(fresh)[:-1], strict=True):
        assert kinds_of_output(before) == kinds_of_output(now), before.source


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_tutorial_is_saved_as_it_ran_from_top_to_bottom(path):
    cells = code_cells(read(path))
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    shown = [kind for cell in cells for kind in kinds_of_output(cell)]
    assert any("image/png" in kind for kind in shown) and "stderr" not in shown
    home = re.findall(r"(?:/home|/root|/tmp|/work)\S*", "".join(str(cell.outputs) for cell in cells))
    assert not home, "paths of the machine that it was saved on"


def test_the_run_folder_that_is_shown_has_all_that_the_page_about_training_lists():
    page = (FOLDER.parent / "docs" / "training.md").read_text(encoding="utf-8")
    table = page.partition("| in the run folder | what it is |")[2].partition("\n\n")[0]
    names = set(re.findall(r"^\| `([\w.]+)/?` \|", table, re.M)) - OF_OTHER_RUNS
    cells = code_cells(read(FOLDER / "2_from_photographs_to_a_compact_model.ipynb"))
    (cell,) = (cell for cell in cells if "iterdir" in cell.source)
    (shown,) = (ast.literal_eval(out.text) for out in cell.outputs if out.get("name") == "stdout")
    assert len(names) >= 8 and set(shown) == names


def test_all_tutorials_are_small_enough_for_a_page():
    assert len(NOTEBOOKS) == len(CLAIMS)
    assert sum(path.stat().st_size for path in NOTEBOOKS) < MOST_BYTES


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_tutorial_uses_public_names_only(path):
    for cell in code_cells(read(path)):
        for node in ast.walk(ast.parse(cell.source)):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import | ast.ImportFrom) else []
            names += [node.attr] if isinstance(node, ast.Attribute) else []
            assert not [name for name in names if name.startswith("_")], cell.source


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_what_a_tutorial_links_to_is_there(path):
    text = "\n".join(cell.source for cell in read(path).cells if cell.cell_type == "markdown")
    targets = re.findall(r"\]\(([^)#\s]+?)(?:#[^)]*)?\)", text)
    assert targets and [target for target in targets if not (FOLDER / target).exists()] == []
