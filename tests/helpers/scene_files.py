"""A small scene file of Mitsuba's, with sensors as views."""

from pathlib import Path

SENSOR = """<sensor type="perspective" {id}><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="{x}, 0, -4" target="{x}, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/>
<string name="pixel_format" value="{format}"/><rfilter type="box"/></film></sensor>"""


def scene_file(folder: Path, pixel_format: str = "rgb", n: int = 3) -> Path:
    sensors = [
        SENSOR.format(id=f'id="cam{i}"' if i else "", x=0.1 * i, format=pixel_format) for i in range(n)
    ]
    emitter = '<emitter type="area"><rgb name="radiance" value="0.5, 0.2, 0.1"/></emitter>'
    sphere = f'<shape type="sphere">{emitter}</shape>'
    integrator = '<integrator type="path"><boolean name="hide_emitters" value="false"/></integrator>'
    file = folder / "scene.xml"
    file.write_text(f'<scene version="3.0.0">{integrator}{sphere}{"".join(sensors)}</scene>')
    return file
