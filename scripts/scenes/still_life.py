"""A model of a still life from a scene that is captured where it stands: capture, training, and a copy in scenes/."""

import shutil
import sys
from pathlib import Path
from xml.etree import ElementTree

from mi_dogsplat.cli.main import main as dogsplat


def made(work: Path, scene: ElementTree.Element, capture: list[str], train: list[str], model: Path) -> None:
    """Write WORK/scene.xml, the photographs WORK/data and the run WORK/run, and copy its model.

    ``capture`` and ``train`` are options of these two commands. A step that is done is not done again. Ends the process
    where one fails.
    """
    work.mkdir(parents=True, exist_ok=True)
    ElementTree.ElementTree(scene).write(work / "scene.xml")
    if dogsplat(["capture", str(work / "scene.xml"), "-o", str(work / "data"), *capture]):
        sys.exit("the capture failed")
    run = work / "run"
    resume = ["--resume"] if (run / "config.json").exists() else []
    if not (run / "metrics.json").exists() and dogsplat(["train", str(work / "data"), "-o", str(run), *train, *resume]):
        sys.exit("the training failed")
    shutil.copy(run / "point_cloud.ply", model)
