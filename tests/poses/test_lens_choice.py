"""Photographs and videos that say that they are panoramas are taken for some, without a flag."""

import struct
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mi_dogsplat.poses import video
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.lens_choice import lens_of_photographs
from mi_dogsplat.poses.run import find_poses
from mi_dogsplat.poses.video import says_panorama
from mi_dogsplat.support.errors import DataError
from PIL import Image

from benchmarks.poses.filmed_scene import write_video

XMP = '<rdf:Description xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" GPano:ProjectionType{}/>'


def write_panorama(file: Path, said: str = '="equirectangular"', size: tuple[int, int] = (64, 32)) -> None:
    Image.new("RGB", size).save(file, xmp=XMP.format(said).encode())


@pytest.mark.parametrize("said", ['="equirectangular"', ">Equirectangular</GPano:ProjectionType"])
@pytest.mark.parametrize("lens", [None, "EQUIRECTANGULAR"])
def test_photographs_that_say_that_they_are_panoramas_are_taken_for_some(tmp_path, said, lens):
    files = [tmp_path / "a.jpg", tmp_path / "b.jpg"]
    for file in files:
        write_panorama(file, said)
    assert lens_of_photographs(files, lens) == "EQUIRECTANGULAR"
    (tmp_path / "c.jpg").write_bytes(b"no picture")  # which is told later, with all others
    assert lens_of_photographs([*files, tmp_path / "c.jpg"], lens) == "EQUIRECTANGULAR"
    assert lens_of_photographs([tmp_path / "c.jpg"], "EQUIRECTANGULAR") == "EQUIRECTANGULAR"


def test_panoramas_that_cannot_be_cut_as_one_are_told_before_anything_is_written(tmp_path):
    for name, width in ("a.jpg", 64), ("b.jpg", 32):
        write_panorama(tmp_path / name, size=(width, width // 2))
    with pytest.raises(DataError, match=r"b.jpg: is 32x16, and a.jpg is 64x32; export all panoramas in one size"):
        lens_of_photographs([tmp_path / "a.jpg", tmp_path / "b.jpg"], None)


def test_photographs_that_say_nothing_have_a_lens(tmp_path):
    write_panorama(tmp_path / "a.jpg", '="cylindrical"')
    assert lens_of_photographs([tmp_path / "a.jpg"], None) == PosesConfig().camera_model == "SIMPLE_RADIAL"
    assert lens_of_photographs([tmp_path / "a.jpg"], "OPENCV") == "OPENCV"
    assert lens_of_photographs([], None) == "SIMPLE_RADIAL"
    write_panorama(tmp_path / "b.jpg", size=(64, 64))  # two pictures, for two eyes
    assert lens_of_photographs([tmp_path / "a.jpg", tmp_path / "b.jpg"], None) == "SIMPLE_RADIAL"


@pytest.mark.parametrize("lens, remedy", [(None, "remove it, or give only such files"),
                                          ("OPENCV", "leave out --lens OPENCV")])  # fmt: skip
def test_a_panorama_among_others_is_no_pinhole(tmp_path, lens, remedy):
    write_panorama(tmp_path / "b.jpg")
    Image.new("RGB", (64, 32)).save(tmp_path / "a.jpg")
    with pytest.raises(DataError, match=f"b.jpg: says that it is a panorama of all directions; {remedy}"):
        find_poses(tmp_path, tmp_path / "out", PosesConfig(lens=lens))
    assert not (tmp_path / "out").exists()


SPHERICAL = b"""<rdf:SphericalVideo xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"
xmlns:GSpherical="http://ns.google.com/videos/1.0/spherical/"><GSpherical:Spherical>true</GSpherical:Spherical>
<GSpherical:Stitched>true</GSpherical:Stitched><GSpherical:StitchingSoftware>a test</GSpherical:StitchingSoftware>
<GSpherical:ProjectionType>equirectangular</GSpherical:ProjectionType></rdf:SphericalVideo>"""
SPHERICAL_BOX = bytes.fromhex("ffcc8263f8554a938814587a02521fdd") + SPHERICAL  # Google's "Spherical Video RFC", V1


def with_box(boxes: bytes, place: list[bytes], kind: bytes, content: bytes) -> bytes:
    """Boxes of an MP4 with one more at the end of the one that ``place`` leads to."""
    if not place:
        return boxes + struct.pack(">I4s", 8 + len(content), kind) + content
    found, at = b"", 0
    while at < len(boxes):
        size, name = struct.unpack_from(">I4s", boxes, at)
        inner = boxes[at + 8 : at + size]
        if name == place[0]:
            inner = with_box(inner, place[1:], kind, content)
        found, at = found + struct.pack(">I4s", 8 + len(inner), name) + inner, at + size
    return found


def write_panorama_video(file: Path, size: tuple[int, int], spherical: bool = True) -> None:
    write_video(file, [np.full((size[1], size[0], 3), 90, np.uint8)])
    if spherical:  # what comes before moov stays where it is
        file.write_bytes(with_box(file.read_bytes(), [b"moov", b"trak"], b"uuid", SPHERICAL_BOX))


@pytest.mark.parametrize("size, spherical, panorama", [
    ((64, 32), True, True), ((64, 32), False, False),
    ((64, 64), True, False),  # for two eyes
])  # fmt: skip
def test_a_video_that_says_that_it_is_one_of_panoramas_is_taken_for_some(tmp_path, size, spherical, panorama):
    write_panorama_video(tmp_path / "walk.mp4", size, spherical)
    assert says_panorama(tmp_path / "walk.mp4") == panorama


@pytest.mark.parametrize("projection, size, aspect, panorama", [
    (0, (64, 32), 1.0, True), (0, (32, 32), 2.0, True), (0, (64, 32), 2.0, False),
    (1, (64, 32), 1.0, False),  # AV_SPHERICAL_CUBEMAP
])  # fmt: skip
def test_a_video_of_panoramas_is_one_as_it_is_shown(monkeypatch, projection, size, aspect, panorama):
    said = {"SPHERICAL": struct.pack("=7I", projection, 1, 2, 3, 4, 5, 6)}
    frame = SimpleNamespace(width=size[0], height=size[1], side_data=said)
    monkeypatch.setattr(video, "read_frames", lambda path: (row for row in [(0, frame, aspect)]))
    assert says_panorama(Path("walk.mp4")) == panorama


def test_a_video_of_panoramas_has_no_lens_of_a_pinhole(tmp_path):
    write_panorama_video(tmp_path / "walk.mp4", (64, 32))
    with pytest.raises(DataError, match="walk.mp4: says that it is a panorama .*; leave out --lens OPENCV"):
        find_poses(tmp_path / "walk.mp4", tmp_path / "out", PosesConfig(lens="OPENCV"))
    with pytest.raises(DataError, match="--undistort: is for lenses"):
        find_poses(tmp_path / "walk.mp4", tmp_path / "out", PosesConfig(undistort=True))
    assert not (tmp_path / "out").exists()
