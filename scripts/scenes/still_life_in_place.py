"""The model of scenes/still_life_in_the_light.xml: captured where it stands, from above and from the floor.

    python -m scripts.scenes.still_life_in_place WORK

writes WORK/scene.xml (the meshes of demo_truth.xml on foot and floor, both cut out of the pictures), WORK/cameras.json,
the photographs WORK/data and the run WORK/run, and copies its model to scenes/still_life_in_place.ply. Three minutes
of one core. A step that is done is not done again.
"""

import json
import math
import sys
from pathlib import Path

import numpy as np
from mi_dogsplat.datasets.camera_paths import hemisphere, look_at

from benchmarks.tracing.lit_scenes import IN_PLACE, in_place

from .still_life import made

SIZE = 256  # pixels
ABOVE = 48, (5.0, 75.0), 5.4, 40.0  # cameras, elevations, distance, field of view: as the model of still_life.xml
FROM_THE_FLOOR = (8, 3.2, 62.0), (8, 2.3, 80.0)  # cameras, distance from the axis, field of view
FLOOR_HEIGHT = -0.6  # of those cameras: the table top begins at -0.14, the floor is at -0.7
CAPTURE = "--spp 64 --alpha --points 8000"
TRAIN = "--preset 3dgs --steps 7000 --max-primitives 5000 --sh-degree 1 --background random --antialiased"


def cameras() -> list[dict]:
    """As ``dogsplat capture --path`` reads them."""
    n, band, distance, fov = ABOVE
    middle = np.array([0, 0, 0.4])
    placed = [(f"above_{i:02d}", middle + distance * d, middle, fov) for i, d in enumerate(hemisphere(n, "z", band))]
    for ring, (n, distance, fov) in enumerate(FROM_THE_FLOOR):
        for i, angle in enumerate((np.arange(n) + 0.5 * ring) * 2 * np.pi / n):
            eye = np.array([distance * np.cos(angle), distance * np.sin(angle), FLOOR_HEIGHT])
            placed.append((f"floor_{ring}{i}", eye, np.array([0, 0, -0.05]), fov))
    size = {"width": SIZE, "height": SIZE}
    return [{"name": name, "w2c": look_at(eye, target, "z").tolist(), **size,
             "fx": SIZE / 2 / math.tan(math.radians(fov / 2))} for name, eye, target, fov in placed]


def main(work: Path) -> None:
    work.mkdir(parents=True, exist_ok=True)
    (work / "cameras.json").write_text(json.dumps(cameras(), indent=1))
    capture = ["--path", str(work / "cameras.json"), *CAPTURE.split()]
    made(work, in_place(), capture, TRAIN.split(), IN_PLACE)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
