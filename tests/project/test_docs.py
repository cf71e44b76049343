"""Every command and program in the README, in docs/ and in the help of the command line does what it says.

Commands of ``dogsplat`` run here, page by page, in a folder that has what they name: photographs, a scene, a model.
Only what makes them long is replaced (``SHORT``). Where that is not enough their options are parsed, and the test named
in ``RUN_ELSEWHERE`` runs them. Targets of make, benchmarks, files, headings and pages that are named have to exist.
"""

import ast
import json
import re
import shlex
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

import mitsuba as mi
import pytest
import tiny_data
from mi_dogsplat import write_ply
from mi_dogsplat.cli import main
from mi_dogsplat.cli.commands import COMMANDS
from mi_dogsplat.cli.parser import EPILOG, build_parser
from mi_dogsplat.export import refine
from mi_dogsplat.render import framing
from mi_dogsplat.scene.camera_file import write_camera
from mi_dogsplat.training.target import checked_target, target_bytes
from PIL import Image

from benchmarks.names import ROOM_OF

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "tutorials/README.md")]
PAGES += sorted((ROOT / "docs").rglob("*.md"))
WRAPPED = 120  # characters of a line that is no table and no picture
# flag and value that a command gets instead of its own, or is given
SHORT = {
    "train": {"--steps": "8", "--max-primitives": "80", "--sh-degree": "1"},
    "prune": {"--steps": "4"},
    "render": {"--spp": "1"},
    "simplify": {"--steps": "4", "--views": "4", "--size": "24 18"},
    "mesh": {"--min-faces": "1", "--voxel": "0.2", "--views": "4", "--size": "80 60"},
    "film": {"--seconds": "0.2", "--fps": "10", "--size": "32 24", "--samples": "2", "--spp": "1"},
    "capture": {"--spp": "1", "--views": "4", "--test": "1", "--size": "24 18", "--points": "100"},
}
# what stands before an export in a program, as in ``folder``; the program itself has imported all that it needs
SHORT_EXPORTS = """\
from mi_dogsplat.export import refine as few
from mi_dogsplat.render import framing as small
few.STEPS, few.MOST_STEPS, few.VANTAGE_SIZE, small.AUTOMATIC_SIZE = 3, 3, (40, 30), (80, 60)
"""
RUN_ELSEWHERE = {
    "--idle": "test_serve.py",
    **{"ablate": "test_ablate.py", "check": "test_check.py", "compare": "test_compare.py", "view": "test_viewer.py"},
    "--resume": "test_resume.py",
    **{word: "test_poses.py" for word in ("poses", "pictures/", "walk.mp4", "posed/")},
    **{word: "test_scan.py" for word in ("scan/", "scanned/")},
}
PARSER = build_parser()
CAPTURED = ("sensors", "cameras.json")  # --path of views that are given, which know no --views


def page_id(page: Path) -> str:
    return str(page.relative_to(ROOT))


def fences(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)


def shell_lines(text: str) -> list[str]:
    """Its commands, without comments; ``export A=b`` and the like stay."""
    lines = text.replace("\\\n", " ").splitlines()
    return [line for line in (re.split(r"\s#|^#", line)[0].strip() for line in lines) if line]


def commands(page: Path) -> list[str]:
    return [line for text in fences(page, "(?:sh|bash)") for line in shell_lines(text)]


def help_examples(text: str) -> list[str]:
    """The commands of a help text; what they do stands two spaces or more behind them, or on the next line."""
    found = re.findall(r"^ +(?:\w+: )?(dogsplat (?:\S+ ?)+?)(?:  .*)?$", text, re.M)
    return [line.strip() for line in found]


HELP = {"dogsplat": EPILOG, **{name: command.EXAMPLES for name, command in COMMANDS.items()}}
EXAMPLES = {name: lines for name, text in HELP.items() if (lines := help_examples(text))}


def shortened(argv: list[str]) -> list[str]:
    """The command with the values of ``SHORT``."""
    argv = list(argv)
    for flag, value in SHORT.get(argv[0], {}).items():
        if flag == "--samples" and "--shutter" not in argv:  # it is for motion blur alone
            continue
        if flag == "--spp" and argv[0] != "capture" and flag not in argv:  # a model has no samples
            continue
        if argv[0] == "capture" and flag in ("--views", "--test", "--size") and set(argv) & set(CAPTURED):
            continue
        if argv[0] == "mesh" and flag in ("--views", "--size") and "--data" in argv:
            continue
        if flag in argv:
            at = argv.index(flag) + 1
            del argv[at : at + (2 if flag == "--size" else 1)]
            argv[at:at] = value.split()
        else:
            argv += [flag, *value.split()]
    if argv[0] == "render" and argv[1].startswith("scenes/"):
        argv += ["-D", "resx=80", "-D", "resy=60"]
    if "--target" in argv:
        at = argv.index("--target") + 1
        target = checked_target(argv[at])
        sizes = {"spz": "700B", "sog": "6kB"}  # the model has 1 kB as SPZ; 3 kB of SOG hold none
        size = next((sizes[word] for word in argv if word in sizes), "3kB")
        argv[at] = size if target_bytes(target) else "20" if float(target) > 1 else argv[at]
    return argv


def run(line: str) -> None:
    """One line of a page, in the present folder."""
    words = shlex.split(line)
    program = Path(words[0]).name
    if program == "dogsplat":
        PARSER.parse_args(words[1:])
        if not set(words) & set(RUN_ELSEWHERE):
            assert not main(shortened(words[1:])), line
    elif program == "make":
        subprocess.run(["make", "-n", *words[1:]], cwd=ROOT, check=True, capture_output=True)
    elif program.startswith("python") and words[1] == "-m":
        assert words[2] in ("pytest", "benchmarks") or import_module(words[2]), line
        if words[2] == "benchmarks" and len(words) > 3:
            assert words[3] in ROOM_OF, line
    elif program.startswith("python"):
        assert (ROOT / words[1]).exists(), line
    elif words[:2] == ["pip", "install"]:
        package = re.fullmatch(r"(?:mi_dogsplat|\.)(?:\[(\w+)\])?", words[2])
        assert package and not words[3:], line
        assert not package[1] or re.search(rf"^{package[1]} = ", (ROOT / "pyproject.toml").read_text(), re.M), line
    elif program == "dask":  # test_compare.py runs a scheduler and workers
        assert words[1] in ("scheduler", "worker"), line
    else:
        pytest.fail(f"{line}: no rule for {program}; run it here, or say in this file why not")


@pytest.fixture(scope="module")
def trained(data, tmp_path_factory) -> Path:
    """A run folder of a tiny training."""
    top = tmp_path_factory.mktemp("trained")
    assert main(shortened(["train", str(data), "-o", str(top / "run")])) == 0
    return top / "run"


@pytest.fixture
def folder(tmp_path, monkeypatch, trained, alpha_data) -> Path:
    """What the pages name: photographs, models, scenes, cameras; it is the present folder."""
    photos = Path(shutil.copytree(alpha_data, tmp_path / "photos"))
    content = json.loads((photos / "transforms.json").read_text())
    for i, frame in enumerate(content["frames"]):
        (photos / frame["file_path"]).rename(photos / "images" / f"{i:04d}.png")
        frame["file_path"] = f"images/{i:04d}.png"
    (photos / "transforms.json").write_text(json.dumps(content))
    for name in ("lego", "data"):
        (tmp_path / name).symlink_to(photos)
    for i in range(len(content["frames"])):
        (tmp_path / "masks").mkdir(exist_ok=True)
        Image.new("L", (tiny_data.WIDTH, tiny_data.HEIGHT), 255).save(tmp_path / "masks" / f"{i:04d}.png")
        (tmp_path / "depth").mkdir(exist_ok=True)
        Image.new("I;16", (8, 6), 3000).save(tmp_path / "depth" / f"{i:04d}.png")
    for name in ("run", "run_a", "run_b"):
        shutil.copytree(trained, tmp_path / name)
    write_ply(tmp_path / "model.ply", tiny_data.truth())
    camera = tiny_data.cameras()[0]
    write_camera(tmp_path / "camera.json", camera)
    write_camera(tmp_path / "cameras.json", camera)
    listed = json.loads((tmp_path / "cameras.json").read_text())
    (tmp_path / "cameras.json").write_text(json.dumps([listed | {"name": "front"}]))
    described = {"w2c": camera.w2c.tolist(), "fx": camera.fx, "width": camera.width, "height": camera.height}
    asked = {"out": str(tmp_path / "frame.npz"), "model": str(tmp_path / "model.ply"), "camera": described}
    (tmp_path / "requests.jsonl").write_text(json.dumps(asked) + "\n")
    keys = [{"time": 3 * i, "position": [3 - i, i, 1], "look_at": [0, 0, 0]} for i in range(3)]
    (tmp_path / "keys.json").write_text(json.dumps({"keys": keys}))
    moved = "matrix4d xformOp:transform = ((1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,4,1))\n"
    moved += 'uniform token[] xformOpOrder = ["xformOp:transform"]'
    for name in ("shot.usda", "shot.usd"):
        (tmp_path / name).write_text(f'#usda 1.0\ndef "World"\n{{\ndef Camera "Camera2"\n{{\n{moved}\n}}\n}}\n')
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    sensor = '<sensor type="perspective"><transform name="to_world"><lookat origin="0,-4,1" target="0,0,0" up="0,0,1"/>'
    sensor += '</transform><film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="18"/>'
    sensors = 2 * f"{sensor}</film></sensor>"
    scene = '<default name="radius" value="1"/><shape type="sphere"><float name="radius" value="$radius"/></shape>'
    scene += '<emitter type="constant"/>'
    splats = '<shape type="dog"><string name="filename" value="model.ply"/></shape>'
    for name, integrator, shapes in (("scene.xml", "path", scene), ("lit.xml", "dogpath", scene + splats)):
        content = f'<integrator type="{integrator}"/>{shapes}{sensors}'
        (tmp_path / name).write_text(f'<scene version="3.0.0">{content}</scene>')
    monkeypatch.setattr(refine, "STEPS", 3)  # of exports, some hundred otherwise
    monkeypatch.setattr(refine, "MOST_STEPS", 3)
    monkeypatch.setattr(refine, "VANTAGE_SIZE", (40, 30))
    monkeypatch.setattr(framing, "AUTOMATIC_SIZE", (80, 60))  # of views that nobody names
    monkeypatch.chdir(tmp_path)
    return tmp_path


def fresh_outputs(lines: list[str], folder: Path) -> None:
    """Folders that commands write must not hold something else already."""
    for line in lines:
        words = shlex.split(line)
        if "-o" in words and words[1] in ("train", "prune", "capture", "film"):
            out = folder / words[words.index("-o") + 1]
            out = out.parent if out.suffix == ".exr" else out
            if out.is_symlink():
                out.unlink()
            elif words[1] in ("capture", "film") and out.is_dir():  # another one, of other settings
                shutil.rmtree(out)


@pytest.mark.slow
@pytest.mark.parametrize("page", [p for p in PAGES if commands(p)], ids=page_id)
def test_the_commands_of_a_page_run(page, folder, capsys):
    lines = commands(page)
    for line in lines:
        fresh_outputs([line], folder)
        run(line)
        capsys.readouterr()


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_of_the_help_run(name, folder, capsys):
    for line in EXAMPLES[name]:
        fresh_outputs([line], folder)
        run(line)
        capsys.readouterr()


@pytest.mark.parametrize("page", [p for p in PAGES if fences(p, "python")], ids=page_id)
def test_the_programs_of_a_page_run(page, folder):
    """Each in a process of its own, and as it stands: a reader has imported nothing and set no variant before it."""
    for text in fences(page, "python"):
        if "aborts" in text or "SLURMCluster" in text:  # shows what ends the process; needs a cluster
            ast.parse(text)
            continue
        fewer = re.sub(r"spp=\d+", "spp=1", text)  # samples and steps, which make it long
        fewer = re.sub(r"\bsteps=\d+", "steps=8", fewer)
        fewer = re.sub(r'(load_file\("scenes/\w+\.xml")\)', r"\1, resx=80, resy=60)", fewer)
        fewer = re.sub(r"^(?=\S.*\bexport_model\()", SHORT_EXPORTS, fewer, flags=re.M)
        command = [sys.executable, "-W", "error", "-c", fewer]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", [p for p in PAGES if fences(p, "xml")], ids=page_id)
def test_the_scenes_of_a_page_load(page, folder):
    for text in fences(page, "xml"):
        root = ElementTree.fromstring(f"<page>{text}</page>")
        for scene in root.findall("scene"):
            mi.load_string(ElementTree.tostring(scene, encoding="unicode"))


def headings(page: Path) -> set[str]:
    """Its headings as the ends of links spell them."""
    titles = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_what_a_page_links_to_is_there(page):
    for target, heading in re.findall(r"\]\(([^)#\s]*)(?:#([^)]*))?\)", page.read_text(encoding="utf-8")):
        if target.startswith("https://"):
            continue
        found = page.parent / target if target else page
        assert found.exists(), target
        assert not heading or heading in headings(found), f"{target}#{heading}"


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_the_files_that_a_page_names_are_there(page):
    """With their folder from the root or from the package, or by their name alone."""
    tops = [ROOT / top for top in ("mi_dogsplat", "tests", "benchmarks", "scripts", "scenes", "blender_addon")]
    names = {path.name for top in tops for path in top.rglob("*")} | {"scene.xml"}  # that one is the reader's own
    for name in re.findall(r"`((?:[\w.]+/)*\w+\.(?:py|sh|xml))`", page.read_text(encoding="utf-8")):
        found = any((top / name).exists() for top in (ROOT, ROOT / "mi_dogsplat")) if "/" in name else name in names
        assert found, name


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_a_page_is_wrapped(page):
    lines = page.read_text(encoding="utf-8").splitlines()
    assert not [line for line in lines if len(line) > WRAPPED and not line.startswith(("|", "![", "`"))]


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_the_commands_within_a_sentence_exist(page):
    """Targets of make, benchmarks, and subcommands with their flags."""
    subcommands: dict = next(a.choices for a in PARSER._actions if isinstance(a.choices, dict))
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.M))
    for span in re.findall(r"`([^`\n]+)`", page.read_text(encoding="utf-8")):
        words = span.split()
        if words[0] == "make" and len(words) == 2:
            assert words[1] in targets, span
        elif words[:3] == ["python", "-m", "benchmarks"] and len(words) > 3:
            assert words[3] in ROOM_OF, span
        elif words[0] == "dogsplat" and len(words) > 1 and words[1].isalpha() and words[1].islower():
            if words[1] in targets | {"and"}:
                continue
            assert words[1] in subcommands, span
            flags = {flag for action in subcommands[words[1]]._actions for flag in action.option_strings}
            assert {w.split("=")[0] for w in words if w.startswith("--")} <= flags, span


@pytest.mark.slow
def test_the_reference_of_the_api_is_made_and_has_every_module(tmp_path):
    command = [sys.executable, "-W", "error", "-m", "scripts.release.api", str(tmp_path), "--without-source"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    named = re.findall(r'"(mi_dogsplat[.\w]*)"', (ROOT / "scripts" / "release" / "api.py").read_text())
    assert len(named) > 10 and all((tmp_path / f"{name.replace('.', '/')}.html").exists() for name in named)
    assert "[N, 3] world space" in (tmp_path / "mi_dogsplat.html").read_text()
    of_page = set(re.findall(r"mi_dogsplat(?:\.\w+)+", (ROOT / "docs" / "python.md").read_text(encoding="utf-8")))
    files = [file.relative_to(tmp_path).with_suffix("") for file in tmp_path.rglob("*.html")]
    pages = {file.as_posix().replace("/", ".") for file in files}
    assert len(of_page) > 20
    assert not {name for name in of_page if not pages & {name, name.rpartition(".")[0]}}


def test_every_public_function_and_class_says_what_it_is():
    silent = [
        f"{path.relative_to(ROOT)}: {node.name}"
        for path in sorted((ROOT / "mi_dogsplat").rglob("*.py"))
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name[0] != "_" and not ast.get_docstring(node)
    ]
    assert not silent
