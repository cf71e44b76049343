"""The linear model of scenes/still_life_indoors.xml: captured where it stands, in the light of that room.

    python -m scripts.scenes.still_life_indoors WORK

writes WORK/scene.xml (the meshes of demo_truth.xml in the room, which cameras look through), the OpenEXR images
WORK/data and the run WORK/run, and copies its model to scenes/still_life_indoors.ply. Ten minutes of one core. A step
that is done is not done again.
"""

import sys
from pathlib import Path

from benchmarks.tracing.lit_scenes import INDOORS, INDOORS_MODEL, ROOM, in_place

from .still_life import made

# From a little below, too: floor and metal ball see the under side of the table top. No camera is under the floor.
CAPTURE = (
    "--hdr --alpha --views 60 --size 256 256 --spp 64 --center 0 0 0.4 --radius 1.85 --elevations -15 70 --zoom 1.2 "
    "--points 8000"
)
# Over a background that changes no fringe of its colour can be learned.
TRAIN = "--steps 6000 --max-primitives 20000 --target 5000 --sh-degree 1 --background random"


def main(work: Path) -> None:
    made(work, in_place(INDOORS, ROOM), CAPTURE.split(), TRAIN.split(), INDOORS_MODEL)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
