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
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.support.variants import set_variant

MODEL = Path("../shared/data/models/playbot_lod2_sh2.ply")
OUT = Path("docs/pictures/film.png")
FRAMES, SIZE = 6, (240, 180)
KEYS = {
    "up": [0, -1, 0],
    "keys": [
        {"time": 0, "position": [-0.6, -1.0, -3.4], "look_at": [0, -0.4, 0], "fov": 32},
        {"time": 2, "position": [1.5, -1.0, -1.2], "look_at": [0, -0.6, 0], "fov": 36},
        {"time": 3, "position": [0.5, -0.95, -0.9], "look_at": [0, -0.8, 0], "fov": 30},
    ],
}


def strip(folder: Path, config: FilmConfig) -> np.ndarray:
    """The frames of a film side by side, [H, n W, 3]."""
    made = make_film(MODEL, folder, config=config)
    frames = [np.array(mi.Bitmap(str(folder / f"{i:04d}.png")))[..., :3] for i in range(made.n_frames)]
    return np.concatenate(frames, axis=1) / 255


def main() -> None:
    """Write the picture."""
    set_variant("auto")
    with tempfile.TemporaryDirectory() as name:
        top = Path(name)
        (top / "keys.json").write_text(json.dumps(KEYS))
        how = {"seconds": 1.0, "fps": FRAMES, "size": SIZE}
        rows = [strip(top / "orbit", FilmConfig(**how)), strip(top / "keys", FilmConfig(str(top / "keys.json"), **how))]
    write_png(OUT, np.concatenate(rows))


if __name__ == "__main__":
    main()
