"""The pictures of docs/film.md: frames of an orbit, of a path through key frames, and of an orbit through a scene.

The first two need ../shared/data.

    python -m scripts.pictures.film
"""

import json
import tempfile
from dataclasses import replace
from pathlib import Path

import mi_dogsplat  # noqa: F401  before Mitsuba: it chooses the LLVM
import mitsuba as mi
import numpy as np
from mi_dogsplat.film.film_config import FilmConfig
from mi_dogsplat.film.make import make_film, make_scene_film
from mi_dogsplat.render.panels import labelled
from mi_dogsplat.render.scene_to_draw import SceneOptions
from mi_dogsplat.support.variants import set_variant

from .panels import write_rows

MODEL = Path("../shared/data/models/playbot_lod2_sh2.ply")
SCENE = Path("scenes/still_life_in_the_light.xml")
FRAMES, SIZE = 6, (240, 180)
KEYS = {
    "up": [0, -1, 0],
    "keys": [
        {"time": 0, "position": [-0.6, -1.0, -3.4], "look_at": [0, -0.4, 0], "fov": 32},
        {"time": 2, "position": [1.5, -1.0, -1.2], "look_at": [0, -0.6, 0], "fov": 36},
        {"time": 3, "position": [0.5, -0.95, -0.9], "look_at": [0, -0.8, 0], "fov": 30},
    ],
}


def frames(folder: Path, texts: list[str]) -> list[np.ndarray]:
    """Those of a film, each with its text."""
    pictures = (np.array(mi.Bitmap(str(folder / f"{i:04d}.png")))[..., :3] / 255 for i in range(FRAMES))
    return [labelled(picture, text) for picture, text in zip(pictures, texts, strict=True)]


def main() -> None:
    """Write the pictures."""
    set_variant("auto")
    turn = [f"orbit, {360 * i // FRAMES} degrees" for i in range(FRAMES)]
    end = KEYS["keys"][-1]["time"]
    way = [f"path, {end * i / (FRAMES - 1):.1f} of {end} s" for i in range(FRAMES)]
    orbit = FilmConfig(seconds=1.0, fps=FRAMES, size=SIZE)
    with tempfile.TemporaryDirectory() as name:
        top = Path(name)
        make_scene_film(SCENE, top / "scene", config=orbit, options=SceneOptions(spp=16, denoise=True))
        write_rows("film_scene.png", [frames(top / "scene", turn)])
        if MODEL.exists():
            (top / "keys.json").write_text(json.dumps(KEYS))
            make_film(MODEL, top / "orbit", config=orbit)
            make_film(MODEL, top / "keys", config=replace(orbit, path=str(top / "keys.json")))
            write_rows("film.png", [frames(top / "orbit", turn), frames(top / "keys", way)])


if __name__ == "__main__":
    main()
