"""``pip install mi_dogsplat`` alone: what works without the packages of the extras, and what is said where it fails."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import tiny_data
from PIL import Image

ROOT = Path(__file__).parents[2]
MODULES = {"pillow": "PIL", "zstandard": "zstandard", "flip-evaluator": "flip_evaluator", "scikit-image": "skimage",
           "fast-simplification": "fast_simplification", "xatlas": "xatlas", "pillow-heif": "pillow_heif"}  # fmt: skip
MODULES |= {name: name for name in ("scipy", "tqdm", "viser", "jinja2", "markupsafe", "filelock", "psutil")}
MODULES |= {name: name for name in ("threadpoolctl", "pycolmap", "av", "rawpy")} | {"usd-core": "pxr"}
HIDDEN = sorted(MODULES.values())
BEHIND_VIEW = {"view": {"tqdm"}}  # what viser brings along

WITHOUT = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {hidden}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())
"""
FIRST_CASE = """
from mi_dogsplat.check import stability
stability.cases = lambda cases=stability.cases: [next(iter(cases()))]
"""
COMMAND = "from mi_dogsplat.cli import main; sys.exit(main(sys.argv[1:]))"
COMMANDS = """
import contextlib, io, json
from mi_dogsplat.cli import main

ends = []
for argv in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main(argv)
    ends.append([status, out.getvalue(), err.getvalue()])
print(json.dumps(ends))
"""
RENDER = """
import mi_dogsplat, mitsuba as mi
mi.set_variant("llvm_ad_rgb")
image = mi.render(mi.load_file(sys.argv[1])).numpy()
assert image.shape == (12, 16, 3) and image.max() > 0.1
"""


def core(code: str, *argv, hidden: list[str] = HIDDEN) -> subprocess.CompletedProcess:
    """Run Python as if only the core was installed, or all but what is hidden."""
    command = [sys.executable, "-W", "error", "-c", WITHOUT.format(hidden=hidden) + code, *map(str, argv)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


def ends_of(*commands: list) -> list[tuple[int, str, str]]:
    """(status, stdout, stderr) of commands without extras, one after the other in one process, which takes as long to
    begin as most of them."""
    done = core(COMMANDS, json.dumps([[str(word) for word in words] for words in commands]))
    assert done.returncode == 0 and done.stderr == "", done.stderr
    return [tuple(end) for end in json.loads(done.stdout)]


@pytest.fixture(scope="module")
def scene(model, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "scene.xml"
    path.write_text(
        '<scene version="3.0.0"><integrator type="dogsplat"/><shape type="dog"><string name="filename" '
        f'value="{model}"/></shape><sensor type="perspective"><transform name="to_world"><lookat origin="3, 0, 1" '
        'target="0, 0, 0" up="0, 0, 1"/></transform><film type="hdrfilm"><integer name="width" value="16"/>'
        '<integer name="height" value="12"/><string name="pixel_format" value="rgb"/></film></sensor></scene>'
    )
    return path


def requirements(name: str) -> set[str]:
    """Packages of a list in pyproject.toml, without their versions."""
    listed = re.search(rf"^{name} = \[(.*)\]$", (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert listed, name
    return set(re.findall(r'"([\w-]+)', listed[1]))


def test_the_core_needs_mitsuba_numpy_and_openexr_only():
    assert requirements("dependencies") == {"mitsuba", "numpy", "OpenEXR"}
    for extra in ("train", "export", "film", "mesh", "usd", "view"):
        assert requirements(extra) <= set(MODULES)  # else they are not hidden here


def test_the_plugins_render_a_scene_without_extras(scene):
    done = core(RENDER, scene)
    assert done.returncode == 0, done.stderr


def pixels_of(path: Path) -> np.ndarray:
    """[H, W, 3 or 4]; read by others, as Mitsuba waits for ever for an .exr where there is one core."""
    if path.suffix == ".png":
        return np.asarray(Image.open(path))
    channels = OpenEXR.File(str(path)).channels()
    return next(channels[name].pixels for name in ("RGBA", "RGB") if name in channels)


def test_a_model_and_a_scene_are_rendered_to_a_file_without_extras(model, scene, tmp_path):
    sources = {tmp_path / (source.stem + suffix): source for source in (model, scene) for suffix in (".png", ".exr")}
    ends = ends_of(*(["render", source, "-o", out] for out, source in sources.items()))
    for out, end in zip(sources, ends, strict=True):
        assert end == (0, f"{out}\n", "")
        assert pixels_of(out).shape[2] >= 3


def test_stability_is_checked_without_extras(tmp_path):
    out = tmp_path / "out"
    done = core(FIRST_CASE + COMMAND, "check", "-o", out, "--only", "stability")
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert [row["verdict"] for row in json.loads((out / "check.json").read_text())["stability"]] == ["right"]
    assert done.stdout.splitlines()[-1] == str(out / "check.json") and not (out / "check.html").exists()


def test_a_model_and_a_run_are_described_without_extras(model, tmp_path):
    (tmp_path / "config.json").write_text('{"data": "photos", "steps": 7}')
    words = {model: "SH degree", tmp_path: "training"}
    commands = [["info", path, *flags] for path in words for flags in ([], ["--features"])]
    for (_, path, *_), (status, out, err) in zip(commands, ends_of(*commands), strict=True):
        assert status == 0 and words[path] in out and err == "", (out, err)


def test_a_missing_extra_is_one_line_that_says_what_to_install(model, tmp_path):
    data = tiny_data.write_tiny_data(tmp_path / "data", n=2)
    names = {"data": data, "model": model, "out": tmp_path / "out"}
    commands = [
        ["train", "{data}", "-o", "{out}"],
        ["eval", "{model}", "{data}"],
        ["render", "{model}", "-o", "{out}.png", "--data", "{data}"],
        ["info", "{data}"],
        ["export", "{model}", "-o", "{out}.spz"],
        ["film", "{model}", "-o", "{out}.mp4"],
        ["mesh", "{model}", "-o", "{out}.ply"],
        ["view", "{model}"],
    ]
    filled = [[word.format(**names) for word in words] for words in commands]
    for (name, *_), (status, out, err) in zip(commands, ends_of(*filled), strict=True):
        assert status == 2 and out == "", (name, out, err)
        extra = name if name in ("export", "film", "mesh", "view") else "train"
        assert re.fullmatch(rf"dogsplat: this needs the package \w+: pip install 'mi_dogsplat\[{extra}\]'\n", err), err
    assert not list(tmp_path.glob("out*"))


@pytest.mark.parametrize("package", ["fast_simplification", "xatlas"])
def test_a_mesh_lacks_a_package_before_its_views_are_drawn(model, tmp_path, package):
    argv = ["mesh", model, "-o", tmp_path / "out.obj", "--faces", "100", "--texture", "64"]
    done = core(COMMAND, *argv, hidden=[package])
    assert done.returncode == 2 and not list(tmp_path.iterdir())
    assert done.stderr == f"dogsplat: this needs the package {package}: pip install 'mi_dogsplat[mesh]'\n"


@pytest.mark.parametrize(
    ("extra", "code", "ends"),
    [
        ("export", 'sys.exit(any(main(["export", model, "-o", out + end]) for end in ends))', [".spz", ".sog"]),
        ("film", 'sys.exit(any(main(["film", model, "-o", out + end, *short]) for end in ends))', [".mp4", ""]),
        ("mesh", 'sys.exit(main(["mesh", model, "-o", out + ".glb", *few]))', [".glb"]),
        ("view", "import mi_dogsplat.viewer.server; open(out, 'w').close()", [""]),
    ],
    ids=["SPZ and SOG", "video and numbered pictures", "mesh", "viewer"],
)
def test_an_extra_has_all_that_its_commands_need(model, tmp_path, extra, code, ends):
    hidden = sorted({MODULES[name] for name in set(MODULES) - requirements(extra)} - BEHIND_VIEW.get(extra, set()))
    said = "from mi_dogsplat.cli import main; _, model, out = sys.argv; short = '--seconds .1 --size 32 32'.split()\n"
    said += "few = '--views 4 --size 32 24 --min-faces 1 --faces 4 --texture 64'.split()\n"
    done = core(f"{said}ends = {ends}\n{code}", model, tmp_path / "out", hidden=hidden)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.glob("out*")} >= {f"out{end}" for end in ends}


@pytest.mark.parametrize("argv", [["poses", "{data}"], ["train", "{data}"], ["poses", "{video}"]], ids=lambda a: a[0])
def test_without_the_extra_poses_only_what_needs_it_is_refused(tmp_path, argv):
    data, video = tmp_path / "pictures", tmp_path / "walk.mp4"
    data.mkdir()
    for k in range(2):
        Image.new("RGB", (8, 8)).save(data / f"{k}.png")
    video.write_bytes(b"")
    hidden = ["av"] if argv[1] == "{video}" else ["pycolmap"]
    command = [word.format(data=data, video=video) for word in argv] + ["-o", str(tmp_path / "out")]
    done = core(COMMAND, *command, hidden=hidden)
    line = f"dogsplat: this needs the package {hidden[0]}: pip install 'mi_dogsplat[poses]'\n"
    assert done.returncode == 2 and done.stderr == line, done
    assert not list((tmp_path / "out").rglob("*.json"))


POSIX = {"fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "posix", "syslog"}  # modules that Windows lacks


def test_no_module_imports_what_windows_lacks():
    """What a function imports by itself is left out: it has to ask first."""
    for path in sorted((ROOT / "mi_dogsplat").rglob("*.py")):
        needed = set()
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Import):
                needed |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                needed.add(node.module)
        assert not needed & POSIX, path
