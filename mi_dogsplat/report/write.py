"""One self-contained page about a run: what came out, how training went, where the pictures differ.

`write_report` shows what a run folder holds (config.json, history.jsonl, metrics.json, test/) and says in
words what it does not hold.
"""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from typing import Any

from ..support.files import replacing
from ..support.wording import count, duration, file_size, finite, fixed
from .curves import curves_section
from .mixture import mixture_section
from .page import page
from .run_folder import Run, read_run
from .views import views_section

READ_CONFIG = "All that config.json holds."


def write_report(run_dir: str | Path) -> Path:
    """Writes ``report.html`` into a run folder and returns its path.

    :raises DataError: the folder does not exist, or one of its .json files is not a JSON object
    """
    run = read_run(run_dir)
    method = f" <small>{escape(run.method)}</small>" if run.method else ""
    sections = [
        f"<h1>{escape(run.data_name)}{method}</h1>",
        *_notices(run),
        _summary(run),
        curves_section(run),
        mixture_section(run),
        views_section(run),
        _settings(run),
    ]
    title = " \u00b7 ".join(filter(None, (run.data_name, run.method)))
    path = run.path / "report.html"
    with replacing(path) as part:
        part.write_text(page(title, "\n".join(sections)), encoding="utf-8")
    return path


def _notices(run: Run) -> list[str]:
    """What is missing, in words; nothing for a complete run."""
    notices = []
    if run.metrics is None:
        words = "This run is not complete: there is no metrics.json, so it was interrupted or is still running."
        if run.history:
            last, planned = run.history[-1], finite(run.config.get("steps"))
            of = f" of {count(planned)}" if planned else ""
            words += (
                f" Last logged: step {count(last.get('step'))}{of} after {duration(last.get('seconds'))}, "
                f"training L1 {fixed(last.get('l1'), 4)}, {count(last.get('n'))} primitives."
            )
        notices.append(words)
    if not run.config:
        notices.append("There is no config.json, so the settings of this run are unknown.")
    if run.broken_rows:
        notices.append(f"Lines of history.jsonl that are not JSON and are left out: {run.broken_rows}.")
    return [f"<p class=notice>{escape(words)}</p>" for words in notices]


def _summary(run: Run) -> str:
    m = run.metrics or {}
    test, train = m.get("test") or {}, m.get("train") or {}
    last = run.history[-1] if run.history else {}
    n_dog = m.get("n_dog", last.get("n_dog"))
    size, _, unit = file_size(m.get("bytes")).partition(" ")

    def on_training(key: str, digits: int) -> str:
        return "" if finite(train.get(key)) is None else f"training {fixed(train.get(key), digits)}"

    tiles = [  # name, value, unit, further words
        (
            "Test PSNR \u2191",
            fixed(test.get("psnr"), 2),
            "dB" if finite(test.get("psnr")) else "",
            on_training("psnr", 2),
        ),
        ("Test SSIM \u2191", fixed(test.get("ssim"), 4), "", on_training("ssim", 4)),
        ("Test FLIP \u2193", fixed(test.get("flip"), 4), "", on_training("flip", 4)),
        (
            "Primitives",
            count(m.get("n", last.get("n"))),
            "",
            f"{count(n_dog)} of them DoG" if n_dog else "no DoG",
        ),
        ("Model file", size, unit, ""),
        (
            "Training",
            duration(m.get("train_seconds", last.get("seconds"))),
            "",
            f"{count(m.get('steps', last.get('step')))} steps",
        ),
    ]
    tile_html = "".join(
        f"<div class=tile><div class=name>{name}</div><div class=value>{value} <small>{unit}</small></div>"
        f"<div class=more>{more}</div></div>"
        for name, value, unit, more in tiles
    )
    render_ms, memory, test_l1 = (finite(v) for v in (m.get("render_ms"), m.get("peak_memory_mb"), test.get("l1")))
    facts = {
        "seed": m.get("seed", run.config.get("seed")),
        "variant": m.get("variant", run.config.get("variant")),
        "test L1": None if test_l1 is None else fixed(test_l1, 4),
        "render": None if render_ms is None else f"{render_ms:.1f} ms per view",
        "peak memory": None if memory is None else f"{count(memory)} MB",
        **(m.get("versions") or {}),
    }
    fact_html = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(str(value))}</dd></div>"
        for name, value in facts.items()
        if value is not None
    )
    return f"<div class=tiles>{tile_html}</div><dl class=facts>{fact_html}</dl>"


def _settings(run: Run) -> str:
    if not run.config:
        return ""
    rows = "".join(
        f"<tr><td><code>{escape(key)}</code></td><td class=value><code>{escape(value)}</code></td></tr>"
        for key, value in _flat(run.config)
    )
    head = f"<h2>Settings</h2><p class=read>{READ_CONFIG}</p>"
    return f"{head}<div class=scroll><table>{rows}</table></div>"


def _flat(config: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    rows = []
    for key, value in config.items():
        if isinstance(value, dict) and value:
            rows += _flat(value, f"{prefix}{key}.")
        else:
            rows.append((f"{prefix}{key}", value if isinstance(value, str) else json.dumps(value)))
    return rows
