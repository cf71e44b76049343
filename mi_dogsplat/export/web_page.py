"""A model as one page of HTML with a viewer inside, to send to somebody: it needs a browser, and no network.

The viewer is SuperSplat Viewer (PlayCanvas, MIT), kept in ``vendor/`` and made again by
``scripts/setup/vendor_viewer.sh``.
The model is in the page as a SOG bundle. The viewer has y up and shows what a SOG file calls -y there, so the model is
turned first; the page says by which rotation.
"""

from __future__ import annotations

import base64
import html
import json
import re
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from string import Template
from tempfile import TemporaryDirectory

import numpy as np

from ..film.subject import Subject
from ..formats.model import Model
from ..formats.read import read_model
from ..formats.write import write_model
from ..render.framing import automatic_camera, robust_sphere
from ..scene.cameras import affine
from ..scene.drawing import drawn_as
from ..scene.orientation import UP, rotation_between
from ..scene.transform import transformed
from ..support.errors import DataError, writing
from ..support.files import replacing
from ..support.versions import versions
from ..support.wording import in_words
from ..training.initialize import region_of_interest
from .stages import on_grids

PAGE = ".html"
BUNDLE = "model.sog"
VIEWER = files("mi_dogsplat.export") / "vendor" / "supersplat_viewer"
VIEWER_FROM_SOG = np.diag([-1.0, -1.0, 1.0])  # half a turn about z, which the viewer gives every model
UP_OF_SOG = np.array([0.0, -1.0, 0.0])


@dataclass(frozen=True, eq=False)
class Opening:
    """How a page shows a model at first.

    Args:
        title: names it.
        position, target: of the camera, [3] each, in the axes of the model.
        up: vertical [3].
        tangents: of half the angles of view that have to be seen, across and up.
        background: grey level, 0..1.
        n_dog: primitives that were DoG; dog: what became of them, "bake" or "drop".
        n_slopes: primitives whose colour varied over them; n_cuts: that a plane cut off; n_shifts: whose place depended
            on the view.
    """

    title: str
    position: np.ndarray
    target: np.ndarray
    up: np.ndarray
    tangents: tuple[float, float]
    background: float = 0.0
    n_dog: int = 0
    dog: str = "bake"
    n_slopes: int = 0
    n_cuts: int = 0
    n_shifts: int = 0


def opening_of(subject: Subject, title: str, dog: str = "bake") -> Opening:
    """From the first of the cameras that took the photographs, or framed whole; ``dog``: as in ``Opening``."""
    splats, cameras = subject.model.splats, subject.data.cameras
    camera = cameras[0] if cameras else automatic_camera(splats, subject.model.drawing.up)
    centre = robust_sphere(splats)[0]
    middles = [region_of_interest(cameras)[0], centre] if cameras else [centre]
    forward = camera.w2c[2, :3]
    depths = [float(forward @ (middle - camera.position)) for middle in middles]
    depth = next((depth for depth in depths if depth > 0), 1.0)  # visitors turn about a point that far away
    tangents = 0.5 * camera.width / camera.fx, 0.5 * camera.height / camera.fy
    target = camera.position + depth * forward
    had = splats.n_dog, dog, int(splats.is_varied.sum()), int(splats.is_cut.sum()), splats.n_shifts
    return Opening(title, camera.position, target, subject.up, tangents, subject.background, *had)


def write_page(out: Path, model: Model, opening: Opening, grids: str | None = None) -> list[str]:
    """Write a model of plain Gaussians as a page; returns a line for each thing that it has no room for.

    Args:
        grids: those that the model is on, by their name in ``SMALL_GRIDS``, and is to be on in the page too.

    Raises ``DataError``.
    """
    turn = rotation_between(opening.up, UP_OF_SOG)
    turned = Model(transformed(model.splats, affine(turn)), replace(model.drawing, up=UP))
    if grids and turned.splats is not model.splats:  # a turn leaves them
        turned = replace(turned, splats=on_grids(turned.splats, grids, drawn_as(model.drawing)))
    with TemporaryDirectory() as folder:
        lost = write_model(Path(folder) / BUNDLE, turned)
        bundle = (Path(folder) / BUNDLE).read_bytes()
    if drawn_as(model.drawing).linear:
        lost.append("the viewer of the page takes linear colours for sRGB, and shows them too dark")
    seen = VIEWER_FROM_SOG @ turn
    scene = {
        "position": (seen @ opening.position).tolist(),
        "target": (seen @ opening.target).tolist(),
        "tangents": opening.tangents,
        "background": [opening.background] * 3,
        "antialiased": drawn_as(model.drawing).antialiased,
        "turned_by": turn.tolist(),
    }
    parts = {
        "version": versions()["mi_dogsplat"],
        "title": html.escape(opening.title),
        "caption": html.escape(f"{opening.title}: {model.splats.n_splats:,} Gaussians{_of_them(opening)}"),
        "about": html.escape(_about(opening)),
        "background": f"rgb({', '.join([str(round(255 * opening.background))] * 3)})",
        "viewer": _vendored("VERSION").decode().strip(),
        "license": _vendored("LICENSE").decode(),
        "viewer_css": _vendored("viewer.css").decode(),
        "viewer_js": base64.b64encode(_vendored("viewer.js.gz")).decode(),
        "model": base64.b64encode(bundle).decode(),
        "scene": json.dumps(scene),
    }
    template = Template((files("mi_dogsplat.export") / "web_page.html").read_text(encoding="utf-8"))
    page = template.substitute(parts)
    with writing(out), replacing(out) as part:
        part.write_text(page, encoding="utf-8", errors="backslashreplace")  # a name may be no UTF-8
    return lost


def read_page(path: Path) -> Model:
    """The model in a page of ours, in its own axes. Raises ``DataError``."""
    text = path.read_text(encoding="utf-8", errors="replace")
    scene, model = (re.search(rf'<script type="[^"]*" id="{id_}">([^<]*)</script>', text) for id_ in ("scene", "model"))
    if not scene or not model:
        raise DataError(path, "is not a web page of dogsplat export", "export it again")
    with TemporaryDirectory() as folder:
        (Path(folder) / BUNDLE).write_bytes(base64.b64decode(model[1]))
        read = read_model(Path(folder) / BUNDLE)
    back = affine(np.array(json.loads(scene[1])["turned_by"]).T)
    return replace(read, splats=transformed(read.splats, back), drawing=replace(read.drawing, up=None))


def _of_them(opening: Opening) -> str:
    """What the Gaussians were, in brackets."""
    said = []
    if opening.n_dog:
        became = {"bake": "baked", "drop": "without their negative lobes"}[opening.dog]
        said.append(f"{opening.n_dog:,} of them Differences of Gaussians, {became}")
    if opening.n_slopes:
        said.append(f"{opening.n_slopes:,} with colours that varied over them, in their mean colours")
    if opening.n_cuts:
        said.append(f"{opening.n_cuts:,} that were cut off, made whole")
    if opening.n_shifts:
        said.append(f"{opening.n_shifts:,} whose places depended on the view, at their mean places")
    return f" ({'; '.join(said)})" if said else ""


def _about(opening: Opening) -> str:
    """How to use the page, and before it why its picture is not that of the model."""
    why, differences = [], []
    if opening.n_dog:
        shown = {"bake": "the Gaussian nearest to it", "drop": "only its primary Gaussian"}[opening.dog]
        why.append("no negative lobes")
        differences.append(f"each Difference of Gaussians is shown as {shown}")
    if opening.n_slopes:
        why.append("no colours that vary over a Gaussian")
        differences.append("these are shown in their mean colours")
    if opening.n_cuts:
        why.append("no Gaussians that a plane cuts off")
        differences.append("each of those is shown as the nearest whole Gaussian")
    if opening.n_shifts:
        why.append("no places that depend on the view")
        differences.append("Gaussians with such places are shown at their mean ones")
    about = "Drag to turn, scroll to come nearer. Made by mi_dogsplat; shown by SuperSplat Viewer."
    if not why:
        return about
    return f"Web viewers know {in_words(why)}: {', '.join(differences)}, so this is not quite the model. {about}"


def _vendored(name: str) -> bytes:
    return (VIEWER / name).read_bytes()
