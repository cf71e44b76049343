"""What COLMAP's incremental mapping is asked for, and what becomes of its answer; it is not called."""

from types import SimpleNamespace

import pytest
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.mapping import PART, reconstruct

pycolmap = pytest.importorskip("pycolmap", reason="needs pycolmap: pip install 'mi_dogsplat[poses]'")


def model(name: str, images: int, points: int) -> SimpleNamespace:
    return SimpleNamespace(name=name, num_reg_images=lambda: images, num_points3D=lambda: points)


MODELS = [model("small", 2, 900), model("sparse", 5, 10), model("dense", 5, 800), model("large", 7, 1)]


@pytest.fixture
def seeds() -> list[int]:
    """Those that pycolmap was given for all that it does."""
    return []


@pytest.fixture
def reconstructed(tmp_path, monkeypatch, seeds):
    """(models, options, what was told of the progress) of so many images, where so many are said to be registered."""
    monkeypatch.setattr(pycolmap, "set_random_seed", seeds.append)
    (tmp_path / PART).mkdir()
    (tmp_path / PART / "left").touch()  # of a search that was ended

    def of(config: PosesConfig, n: int, registered: int = 0) -> tuple:
        told, options = [], []

        def grow(database, images, part, asked, *, initial_image_pair_callback, next_image_callback) -> dict:
            assert (database, images, part) == tuple(str(tmp_path / name) for name in ("a.db", "images", PART))
            assert [path.name for path in tmp_path.iterdir()] == [PART] and not list((tmp_path / PART).iterdir())
            options.append(asked)
            for _ in range(2):  # two models, which may share images
                initial_image_pair_callback()
                for _ in range(registered - 2):
                    next_image_callback()
            return dict(enumerate(MODELS))

        monkeypatch.setattr(pycolmap, "incremental_mapping", grow)
        models = reconstruct(pycolmap, tmp_path / "a.db", tmp_path / "images", n, config, lambda *row: told.append(row))
        assert not list(tmp_path.iterdir())
        return models, options[0], told

    return of


def test_models_come_with_the_one_of_most_images_first_and_then_of_most_points(reconstructed):
    assert [model.name for model in reconstructed(PosesConfig(), 9)[0]] == ["large", "dense", "sparse", "small"]


def test_never_more_images_are_told_than_there_are(reconstructed):
    told = reconstructed(PosesConfig(), 4, 5)[2]
    assert told == 2 * [(2, 4), (3, 4), (4, 4), (4, 4)]


@pytest.mark.parametrize("n, least", [(2, 2), (3, 3), (200, 3)])
def test_two_images_may_be_a_model_but_no_two_of_many(reconstructed, seeds, n, least):
    _, options, _ = reconstructed(PosesConfig(seed=7), n)
    assert options.min_model_size == least
    assert {options.random_seed, options.mapper.random_seed, options.triangulation.random_seed} == {7}
    assert seeds == [7]


@pytest.mark.parametrize("lens", ["OPENCV", "EQUIRECTANGULAR"])
def test_lenses_are_refined_unless_we_made_the_views_ourselves(reconstructed, lens):
    _, options, _ = reconstructed(PosesConfig(lens=lens), 9)
    pipeline = "ba_refine_focal_length", "ba_refine_extra_params", "ba_refine_sensor_from_rig"
    refined = {getattr(options, name) for name in pipeline}
    refined |= {getattr(options.mapper, f"abs_pose_refine_{name}") for name in ("focal_length", "extra_params")}
    assert refined == {lens == "OPENCV"}


def test_nothing_of_a_search_that_is_stopped_is_left(tmp_path, monkeypatch):
    def stop(database, images, part, *_, **__) -> dict:
        (tmp_path / PART / "0").mkdir()
        raise KeyboardInterrupt

    monkeypatch.setattr(pycolmap, "incremental_mapping", stop)
    with pytest.raises(KeyboardInterrupt):
        reconstruct(pycolmap, tmp_path / "a.db", tmp_path, 9, PosesConfig(), lambda *_: None)
    assert not list(tmp_path.iterdir())
