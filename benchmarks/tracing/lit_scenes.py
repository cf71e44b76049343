"""Scenes in which splats and surfaces light each other, and the same with the meshes that the model learned from."""

import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mitsuba as mi
import numpy as np

SCENES = Path(__file__).parents[2] / "scenes"
LIGHT, INDOORS = SCENES / "still_life_in_the_light.xml", SCENES / "still_life_indoors.xml"
STAGE = "floor", "foot"  # of LIGHT: what its model stands on
WALLS = "ceiling", "back_wall", "front_wall", "left_wall", "right_wall"
ROOM = "floor", *WALLS, "table", "mirror", "metal"  # of INDOORS, but for lamp and window
SHADE = SCENES / "still_life_in_the_shade.xml"
MODEL, MESHES = SCENES / "still_life.ply", SCENES / "demo_truth.xml"
INDOORS_MODEL = SCENES / "still_life_indoors.ply"
IN_PLACE = SCENES / "still_life_in_place.ply"  # the model of LIGHT


def loaded(path: Path, model: Path | None = None) -> Any:
    """A scene, with another model in place of its own."""
    if model is None:
        return mi.load_file(str(path))
    root = _absolute(path)
    of_model = next(node for shape in root.findall("shape") for node in shape.findall("string")
                    if shape.get("type") == "dog")
    of_model.set("value", str(model.absolute()))
    return _parsed(root)


def of_meshes(path: Path, black: bool = False, alone: bool = False) -> Any:
    """A scene with the meshes of demo_truth.xml in place of the model, and the integrator ``path``.

    alone: without any other shape.
    """
    root = without_model(path)
    for shape in root.findall("shape") if alone else ():
        root.remove(shape)
    root.extend(_meshes(black))
    return _parsed(root)


def with_lamp(path: Path, lamp: ElementTree.Element) -> Any:
    """A scene with another shape in place of its shapes ``lamp`` and ``window``, and of its model."""
    root = _absolute(path)
    for shape in root.findall("shape"):
        if shape.get("id") in ("lamp", "window") or shape.get("type") == "dog":
            root.remove(shape)
    root.append(lamp)
    return _parsed(root)


def with_pattern(path: Path, shape: str) -> Any:
    """A scene of which one shape has the picture of a table top, several times over, as its colour."""
    root = _absolute(path)
    for material in root.findall(f"shape[@id='{shape}']/bsdf"):
        material.remove(next(iter(material.findall("rgb"))))
        texture = ElementTree.SubElement(material, "texture", type="bitmap", name="diffuse_reflectance")
        ElementTree.SubElement(texture, "string", name="filename", value=str(SCENES / "demo_textures" / "table.png"))
        repeated = ElementTree.SubElement(texture, "transform", name="to_uv")
        ElementTree.SubElement(repeated, "scale", value="6")
    return _parsed(root)


def meshes_alone() -> Any:
    """The meshes of demo_truth.xml and nothing else."""
    root = ElementTree.Element("scene", version="3.0.0")
    root.extend(_meshes())
    return _parsed(root)


def in_place(path: Path = LIGHT, stage: tuple[str, ...] = STAGE) -> ElementTree.Element:
    """What a scene's model was captured in: its meshes among the shapes of the stage, in the light of the scene.

    The stage throws its light and its shadows onto them, but cameras look through it. As emitters of no light
    ``hide_emitters`` takes its shapes away; nothing samples them. Other shapes are not there yet, but for lamps. The
    integrator is ``path``.
    """
    root = without_model(path)
    for shape in root.findall("shape"):
        if shape.find("emitter") is not None:
            continue
        if shape.get("id") in stage:
            emitter = ElementTree.SubElement(shape, "emitter", type="area")
            ElementTree.SubElement(emitter, "rgb", name="radiance", value="0")
            ElementTree.SubElement(emitter, "float", name="sampling_weight", value="0")
        else:
            root.remove(shape)
    root.extend(_meshes())
    return root


def empty(path: Path) -> Any:
    """A scene without the model, and the integrator ``path``."""
    return _parsed(without_model(path))


def without_model(path: Path) -> ElementTree.Element:
    root = _absolute(path)
    for shape in root.findall("shape"):
        if shape.get("type") == "dog":
            root.remove(shape)
    for integrator in root.findall("integrator"):
        integrator.set("type", "path")
        for node in integrator.findall("*[@name='mesh_shadows']"):
            integrator.remove(node)
    return root


def picture(scene: Any, spp: int, size: tuple[int, int], seed: Any = 0, integrator: Any = None) -> np.ndarray:
    """[H, W, 3] linear radiance of the first sensor, at another size."""
    _resize(scene, size)
    return np.array(mi.render(scene, spp=spp, seed=seed, integrator=integrator))[..., :3]


def for_denoiser(scene: Any, spp: int, size: tuple[int, int], seed: Any = 0) -> tuple[np.ndarray, list[str]]:
    """[H, W, C] the same by ``dogpath`` with the channels that a denoiser asks for, and the names of those."""
    _resize(scene, size)
    integrator = scene.integrator()
    integrator.denoising = True
    image = np.array(mi.render(scene, spp=spp, seed=seed), np.float32)
    names = integrator.aov_names()
    integrator.denoising = False
    return image, names


def _resize(scene: Any, size: tuple[int, int]) -> None:
    params: Any = mi.traverse(scene)
    params[next(name for name in params.keys() if name.endswith("film.size"))] = list(size)
    params.update()


def _meshes(black: bool = False) -> list[ElementTree.Element]:
    """Shapes and paints of demo_truth.xml, without its lights."""
    nodes = list(_absolute(MESHES))
    shapes = [node for node in nodes if node.tag == "shape" and node.find("emitter") is None]
    if not black:
        return [node for node in nodes if node.tag == "bsdf"] + shapes
    for shape in shapes:
        for paint in shape.findall("bsdf") + shape.findall("ref"):
            shape.remove(paint)
        paint = ElementTree.SubElement(shape, "bsdf", type="diffuse")
        ElementTree.SubElement(paint, "rgb", name="reflectance", value="0")
    return shapes


def _absolute(path: Path) -> ElementTree.Element:
    """A scene whose files are named from the root."""
    root = ElementTree.parse(path).getroot()
    for node in root.iter("string"):
        if node.get("name") == "filename":
            node.set("value", str(SCENES / str(node.get("value"))))
    return root


def _parsed(root: ElementTree.Element) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        ElementTree.ElementTree(root).write(file := Path(folder) / "scene.xml")
        return mi.load_file(str(file))
