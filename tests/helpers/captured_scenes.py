"""Small Mitsuba scenes to capture, as XML files."""

from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.support.errors import DataError

# Eight balls of eight colours at the corners of a box: no rotation or mirroring maps the scene to itself.
BALLS = [(x, y, z) for x in (-1, 1) for y in (-0.7, 0.7) for z in (-0.5, 0.5)]
RADIUS = 0.4
BAND = (12.0, 65.0)  # degrees: elevations of cameras
BALL = """
<shape type="sphere"><point name="center" x="{}" y="{}" z="{}"/><float name="radius" value="0.4"/>
<bsdf type="diffuse"><rgb name="reflectance" value="{}, {}, {}"/></bsdf></shape>"""
PATH = '<integrator type="path"/>'
SENSOR = """<sensor type="{kind}" id="{id}">{extra}
<transform name="to_world"><lookat origin="{origin}" target="0.1, 0.2, 0" up="0.1, 0.2, 1"/>{last}</transform>
<film type="hdrfilm"><integer name="width" value="40"/><integer name="height" value="30"/>
<string name="pixel_format" value="rgba"/>{film}<rfilter type="box"/>
</film></sensor>"""


def sensor(name: str, origin: str = "3, -4, 2", kind: str = "perspective", extra="", film="", last="") -> str:
    """A sensor that looks at the balls with a slight roll; ``last`` is applied to its pose first."""
    pose = SENSOR.format(kind=kind, id=name, extra=extra, origin=origin, film=film, last="")
    return pose.replace('<transform name="to_world">', f'<transform name="to_world">{last}')


def balls() -> str:
    return "".join(BALL.format(*p, *(0.1 + 0.8 * (np.sign(p) > 0))) for p in BALLS)


def write_scene(folder: Path, *parts: str, integrator: str = PATH, light: str = '<emitter type="constant"/>') -> Path:
    """Write ``scene.xml``: the balls under an even light, and more."""
    file = folder / "scene.xml"
    file.write_text(f'<scene version="3.0.0">{integrator}{light}{balls()}{"".join(parts)}</scene>')
    return file


def tiny(**settings) -> CaptureConfig:
    return CaptureConfig(**{**dict(views=2, test=1, size=(32, 24), spp=4, points=200, elevations=BAND), **settings})


def error_of(*arguments) -> str:
    """The one line that ``capture`` ends with."""
    with pytest.raises(DataError) as raised:
        capture(*arguments)
    assert "\n" not in str(raised.value)
    return str(raised.value)
