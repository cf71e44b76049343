"""Which pairs of images are matched, and what the matches say about a capture."""

import weakref
from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mi_dogsplat.poses import matching
from mi_dogsplat.poses.advice import Outcome, advice_on_capture, advice_on_model, hopeless
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.evidence import CARRIED, Evidence, translation_shares
from mi_dogsplat.poses.matching import (
    ALIKE,
    BESIDE,
    DONE,
    EXHAUSTIVE,
    EXHAUSTIVE_VIDEO,
    LOOPS,
    WINDOW,
    pairs_of_many,
    pairs_of_video,
)
from mi_dogsplat.poses.retrieval import nearest, similarities

SIZE = 640, 480
GOOD = Evidence(features=3000, matches=800, n_pairs=300, explained=0.8, rotating=0.01, still=0.01)
WHOLE = Outcome(100, 100, (), 0.6)


def places(n: int, per_place: int, seed: int = 0) -> list[np.ndarray]:
    """Descriptors of ``n`` images; image i shows place i // ``per_place``, with noise and some clutter of its own."""
    rng = np.random.default_rng(seed)
    own = [rng.integers(0, 120, (150, 128)) for _ in range(-(-n // per_place))]
    return [
        np.concatenate([own[i // per_place] + rng.integers(0, 20, (150, 128)), rng.integers(0, 120, (50, 128))])
        for i in range(n)
    ]


def test_images_of_one_place_look_most_alike():
    similarity = similarities(places(24, 4), seed=0)
    for i, row in enumerate(similarity):
        alike = {int(j) for j in np.argsort(-row) if j != i and j // 4 == i // 4}
        assert {int(j) for j in np.argsort(-row)[:4]} - {i} == alike
    assert (similarities(places(24, 4), seed=0) == similarity).all()


def test_an_image_without_features_is_like_none():
    descriptors = [*places(6, 3), np.zeros((0, 128), np.uint8)]
    similarity = similarities(descriptors, seed=0)
    assert np.isfinite(similarity).all() and (similarity[6] == 0).all()
    assert similarities([np.zeros((0, 128), np.uint8)] * 3, seed=0).shape == (3, 3)


def test_frames_are_matched_with_their_neighbours_with_far_ones_and_where_a_loop_closes():
    n = 200
    similarity = np.eye(n)
    similarity[3, 190] = similarity[190, 3] = 0.9
    pairs = pairs_of_video(similarity)
    assert (3, 190) in pairs and (0, WINDOW) in pairs and (0, 64) in pairs
    assert all(i < j for i, j in pairs) and len(set(pairs)) == len(pairs) < n * (WINDOW + LOOPS + 5)


def test_many_photographs_are_matched_with_those_that_look_alike():
    n = 300
    similarity = np.random.default_rng(0).random((n, n))
    similarity = similarity + similarity.T
    pairs = set(pairs_of_many(similarity))
    assert {(i, i + BESIDE) for i in range(n - BESIDE)} <= pairs
    assert nearest(similarity, ALIKE) <= pairs and len(pairs) < n * (ALIKE + BESIDE)


@dataclass
class Asked:
    """What COLMAP and the comparison of all images are asked for."""

    pairs: list[tuple[str, str]] = field(default_factory=list)  # of names, in all calls
    seeds: set[int] = field(default_factory=set)
    on_gpu: set[bool] = field(default_factory=set)
    together: int = 0  # images whose descriptors were held when others were read, at most


@pytest.fixture
def matched(tmp_path, monkeypatch):
    """What is asked for images of these names, of which none looks like another; in all calls."""
    pycolmap, asked = pytest.importorskip("pycolmap"), Asked()
    read: list[weakref.ref] = []

    def nothing(number: int) -> SimpleNamespace:
        asked.together = max(asked.together, sum(array() is not None for array in read))
        data = np.zeros((0, 128), np.uint8)
        read.append(weakref.ref(data))
        return SimpleNamespace(data=data)

    def compared(descriptors: Iterable[np.ndarray], seed: int) -> np.ndarray:
        asked.seeds.add(seed)
        return similarities(descriptors, seed)

    def note(database: str, options, pairing, verification, device) -> None:
        lines = Path(pairing.match_list_path).read_text().splitlines()
        asked.pairs.extend((a, b) for a, b in map(str.split, lines))
        asked.seeds.add(verification.ransac.random_seed)
        asked.on_gpu |= {options.use_gpu, device == pycolmap.Device.cuda}

    def of(names: list[str], config: PosesConfig, progress=lambda done, n: None, video: bool = False) -> Asked:
        images = [SimpleNamespace(name=name, image_id=-k) for k, name in enumerate(names)]
        content = SimpleNamespace(read_all_images=lambda: images, read_descriptors=nothing)
        monkeypatch.setattr(matching, "opened", lambda *_: nullcontext(content))
        monkeypatch.setattr(matching, "nearest", lambda *_, **__: set())
        monkeypatch.setattr(matching, "similarities", compared)
        monkeypatch.setattr(pycolmap, "match_image_pairs", note)
        matching.match(pycolmap, tmp_path / "a.db", video, config, progress)
        assert [path.name for path in tmp_path.iterdir()] == [DONE]
        return asked

    return of


def test_of_a_large_set_the_descriptors_of_one_image_after_the_other_are_looked_at(matched):
    """Those of ten thousand photographs together would have 10 GB."""
    assert matched([str(k) for k in range(EXHAUSTIVE + 1)], PosesConfig()).together <= 1


@pytest.mark.parametrize("video, most", [(False, EXHAUSTIVE), (True, EXHAUSTIVE_VIDEO)])
def test_one_image_too_many_for_all_pairs_has_those_beside_it_alone(matched, tmp_path, monkeypatch, video, most):
    monkeypatch.setattr(matching, "BATCH", most**2)
    offsets = {*range(1, WINDOW + 1), 16, 32} if video else set(range(1, BESIDE + 1))
    for n, allowed in (most, set(range(1, most))), (most + 1, offsets):
        asked = matched([str(k) for k in range(n)], PosesConfig(), video=video)
        pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if j - i in allowed]
        assert sorted((int(a), int(b)) for a, b in asked.pairs) == pairs
        asked.pairs.clear()
        (tmp_path / DONE).unlink()


@pytest.mark.parametrize("gpu", [False, True])
def test_matching_computes_where_and_with_the_seed_that_is_asked_for(matched, gpu):
    asked = matched([str(k) for k in range(EXHAUSTIVE + 1)], PosesConfig(seed=7, gpu=gpu))
    assert asked.on_gpu == {gpu} and asked.seeds == {7}


def test_photographs_are_beside_each_other_as_one_counts(matched):
    n = EXHAUSTIVE + 10
    pairs = matched([f"{k}.jpg" for k in range(n)], PosesConfig()).pairs
    assert {(f"{k}.jpg", f"{k + 1}.jpg") for k in range(n - 1)} <= set(pairs) and len(pairs) < n * (BESIDE + 1)


@pytest.mark.parametrize("lens", [None, "EQUIRECTANGULAR"])
def test_all_pairs_of_few_are_matched_but_not_two_views_of_one_panorama(matched, lens):
    names = [f"{side}/{room}/1.jpg" for side in ("front", "up") for room in "abc"]
    expected = {(a, b) for a in names for b in names if a < b and (lens is None or a[-7:] != b[-7:])}
    found = matched(names, PosesConfig(lens=lens)).pairs
    assert set(found) == expected and len(found) == len(expected)


def test_matching_that_was_stopped_goes_on_with_the_pairs_that_are_left(matched, monkeypatch):
    monkeypatch.setattr(matching, "BATCH", 4)
    monkeypatch.setattr(matching, "usable_cores", lambda: 1)
    told = []

    def stop(done: int, n: int) -> None:
        told.append((done, n))
        if done == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        matched(list("abcde"), PosesConfig(), stop)
    assert told == [(0, 10), (4, 10), (8, 10)]
    found = matched(list("abcde"), PosesConfig(), lambda done, n: told.append((done, n))).pairs
    assert told[3:] == [(8, 10), (10, 10)] and len(set(found)) == len(found) == 10
    matched(list("abcde"), PosesConfig(), lambda done, n: told.append((done, n)))
    assert told[5:] == [(10, 10)] and len(found) == 10


def homography(rotation: np.ndarray, t_over_d: np.ndarray, normal: np.ndarray, focal: float) -> np.ndarray:
    """Of a plane with this normal at distance 1, in the first camera's axes (Hartley and Zisserman, 13.2)."""
    K = np.array([[focal, 0, SIZE[0] / 2], [0, focal, SIZE[1] / 2], [0, 0, 1]])
    return K @ (rotation - np.outer(t_over_d, normal)) @ np.linalg.inv(K)


def motion_of(H: np.ndarray) -> float:
    x, y = np.meshgrid(np.linspace(0, SIZE[0], 20), np.linspace(0, SIZE[1], 20))
    points = np.stack([x.ravel(), y.ravel(), np.ones(400)])
    there = H @ points
    return float(np.median(np.linalg.norm(there[:2] / there[2] - points[:2], axis=0))) / SIZE[0]


def turned(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])


def rotating(Hs: list[np.ndarray]) -> float:
    """Share of the pairs that one focal length makes rotations."""
    shares = np.array([translation_shares(H, [SIZE, SIZE], motion_of(H)) for H in Hs])
    return float((shares < CARRIED).mean(axis=0).max())


@pytest.mark.parametrize("focal", [400.0, 600.0, 1100.0])
def test_rotations_are_seen_as_such_whatever_the_focal_length(focal):
    angles = (0.05, 0.1, -0.15, 0.2, 0.4)
    Hs = [3 * homography(turned(a), np.zeros(3), np.array([0, 0, 1]), focal) for a in angles]  # of whatever scale
    assert rotating(Hs) == 1


@pytest.mark.parametrize("normal", [(0, 0, 1), (0.5, 0, 0.866)])
@pytest.mark.parametrize("t", [(0.1, 0, 0), (0, 0.1, 0.02), (0, 0, 0.2), (0.3, 0, 0.1)])
def test_a_plane_that_is_passed_is_no_rotation(t, normal):
    Hs = [homography(turned(angle), np.array(t), np.array(normal), 600.0) for angle in (0, 0.05, -0.1, 0.1, 0.2, -0.2)]
    assert rotating(Hs) < 0.5


def test_a_good_capture_gets_no_advice():
    assert not advice_on_capture(GOOD) and not advice_on_model(WHOLE) and not hopeless(GOOD)


@pytest.mark.parametrize(
    "changed, word",
    [
        ({"features": 80.0}, "too few features"),
        ({"features": 80.0, "matches": 12.0}, "too few features"),
        ({"matches": 12.0}, "hardly overlap"),
        ({"matches": 0.0}, "hardly overlap"),
        ({"rotating": 0.95}, "turns but is not"),
        ({"still": 0.7}, "stands still"),
        ({"explained": 0.2}, "moves by itself"),
    ],
)
def test_each_defect_of_a_capture_has_its_sentence(changed, word):
    (advice,) = advice_on_capture(Evidence(**(vars(GOOD) | changed)))
    assert word in str(advice) and str(advice).count("; ") == 1
    assert hopeless(Evidence(**(vars(GOOD) | changed))) == ("rotating" in changed or changed.get("matches") == 0)


def test_where_no_pair_moves_nothing_is_said_about_motion():
    assert not advice_on_capture(Evidence(3000, 800, 0, 0.0, 0.0, 0.0))


def test_each_defect_of_a_model_has_its_sentence():
    (few,) = advice_on_model(Outcome(100, 60, (25, 10), 0.6))
    assert "only 60 of 100 images have a pose, others form groups of 25, 10;" in str(few)
    (alone,) = advice_on_model(Outcome(100, 60, (), 0.6))
    assert alone.problem == "only 60 of 100 images have a pose"
    (coarse,) = advice_on_model(Outcome(100, 100, (), 2.5))
    for angles, first in ((60.0, 121.0, 8.0), 121), ((8.0, 60.0), 8):
        (odd,) = advice_on_model(Outcome(100, 100, (), 0.6, angles))
        assert f"comes out {first}° wide" in str(odd) and "EXIF" in str(odd)
    assert "2.50 px" in str(coarse) and "--lens OPENCV" in str(coarse)
