"""The picture of docs/film.md: frames of an orbit, and of a path through key frames. Needs ../shared/data.

    python -m scripts.pictures.film
"""

import json
import tempfile
from pathlib import Path

import mi_dogsplat  # noqa: F401  before Mitsuba: it chooses the LLVM
import mitsuba as mi
import numpy as np
from mi_dogsplat.film.film_config import FilmConfig
from mi_dogsplat.film.make import make_film
from mi_dogsplat.render.panels import labelled
from mi_dogsplat.support.variants import set_variant

from .panels import write_rows

MODEL = Path("../shared/data/models/playbot_lod2_sh2.ply")
FRAMES, SIZE = 6, (240, 180)
KEYS = {
    "up": [0, -1, 0],
    "keys": [
        {"time": 0, "position": [-0.6, -1.0, -3.4], "look_at": [0, -0.4, 0], "fov": 32},
        {"time": 2, "position": [1.5, -1.0, -1.2], "look_at": [0, -0.6, 0], "fov": 36},
        {"time": 3, "position": [0.5, -0.95, -0.9], "look_at": [0, -0.8, 0], "fov": 30},
    ],
}


def frames(folder: Path, config: FilmConfig, texts: list[str]) -> list[np.ndarray]:
    """Those of a film, each with its text."""
    make_film(MODEL, folder, config=config)
    pictures = (np.array(mi.Bitmap(str(folder / f"{i:04d}.png")))[..., :3] / 255 for i in range(FRAMES))
    return [labelled(picture, text) for picture, text in zip(pictures, texts, strict=True)]


def main() -> None:
    """Write the picture."""
    set_variant("auto")
    with tempfile.TemporaryDirectory() as name:
        top = Path(name)
        (top / "keys.json").write_text(json.dumps(KEYS))
        how = {"seconds": 1.0, "fps": FRAMES, "size": SIZE}
        turn = [f"orbit, {360 * i // FRAMES} degrees" for i in range(FRAMES)]
        end = KEYS["keys"][-1]["time"]
        way = [f"path, {end * i / (FRAMES - 1):.1f} of {end} s" for i in range(FRAMES)]
        rows = [
            frames(top / "orbit", FilmConfig(**how), turn),
            frames(top / "keys", FilmConfig(str(top / "keys.json"), **how), way),
        ]
    write_rows("film.png", rows)


if __name__ == "__main__":
    main()
