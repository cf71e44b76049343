"""All settings of a training run; what stands beside a field's type is the help text of its flag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from ..datasets.dataset import SPLITS
from ..datasets.world import Length, Unit, Up, check_world
from ..render.picture_options import NEAR, Antialiased, Background, Downscale
from ..support.memory import bytes_of
from ..support.settings import Setting, check_settings, refuse
from .presets import RECIPES
from .target import REMEDY, checked_target, require_below_cap, target_bytes, target_in_words

FROM_RECIPE: Any = None  # a default that the preset decides on when the configuration is made
PRUNING_PRESETS = "use " + " or ".join(name for name in RECIPES if RECIPES[name].pruning)
# may change from one start of a run to the next, as no result depends on them
FREE = ("checkpoint_seconds", "memory", "up", "scale", "unit")
FREE_TO_RESUME = (*FREE, "data_on_disk")  # as the numbers of images are the same from there
PRESETS = (
    "recipe of the training: ours; or one that adds to it, each to the one before: ours_slopes (colours that vary over "
    "a primitive), ours_cuts (planes that cut primitives off), ours_preconditioned (preconditioned steps), "
    "ours_second_cuts (a second plane), ours_curvatures (brightness that curves over a primitive), ours_shifts (places "
    "that depend on the view), ours_early (a shorter growth in larger steps); or paper (the method as printed), "
    "released (the method as in its authors' code), 3dgs (the baseline)"
)
WORLD_SCALE = "remove primitives that are larger than this many camera extents (default: the preset's)"
VARIANT = "Mitsuba variant; auto takes cuda_ad_rgb if there is a GPU, else llvm_ad_rgb"
TESTS = "steps between measurements of PSNR and FLIP on the test views; 0: measure eight times"
MEASURED = (
    "views on which the model is measured: test or validation; validation views are the data's own, or else every 8th "
    "training view, and no test view is read then"
)
USUAL_NEAR = "(default: 0.2, or a sixteenth of the camera extent if that is less)"
NEAR_ZONE = "remove primitives that are nearer than this to a training camera, in world units; 0: none"
APPEARANCE = "learn the exposure and white balance of each training image, and the vignetting of each camera"
BATCH = "views in each step, whose gradients are averaged; step sizes grow with the square root of N"
REFINE_POSES = "correct the poses of the training views, by the photographs, while the model is trained"
PRECONDITIONED = (
    "after pruning, move the numbers of each primitive together; ours_preconditioned and the presets that add to it "
    "always do so"
)
GROWTH = (
    "share of the steps in which the model grows; these steps become twice as large, and what follows begins earlier "
    "(default: that of the preset, mostly a half, with the step sizes of 3DGS)"
)
MASKS = "folder of masks, named like the images; black pixels do not count"
DEPTHS = "folder of depth maps, named like the images (PNG in millimetres, .npy or .exr), which the model has to follow"
FORMATS = ("ply", "spz", "sog")
FORMAT = f"file to train for ({', '.join(FORMATS)}): the last part of the training sees the model as that file holds it"
TARGET = (
    "size after pruning: a ratio (0.1, 10%), a count of primitives (20000), or the size of the file (2MB); primitives "
    "that fade later are removed as well"
)
WHITE = "radiance that is shown as white, for OpenEXR images (default: twice the 95th percentile of their luminances)"
MEMORY = "memory that the training may use, such as 8G; on a GPU its own memory (default: what is free)"
CHECKPOINTS = "seconds between checkpoints; more if they would take over a fiftieth of the time"


@dataclass(frozen=True)
class TrainConfig:
    """A run is reproducible from this, the data and the versions in ``metrics.json``.

    Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed.
    """

    data: Annotated[str, Setting("data set: a COLMAP folder, a folder with transforms*.json, or a Mitsuba scene XML")]
    preset: Annotated[str, Setting(PRESETS, choices=tuple(RECIPES))] = "ours"
    steps: Annotated[
        int, Setting("training steps; the whole schedule is scaled to them (default: the preset's)", least=1)
    ] = FROM_RECIPE
    target: Annotated[str | float, Setting(TARGET, metavar="X")] = 0.1
    growth: Annotated[float | None, Setting(GROWTH, "X", least=0.05, most=0.6)] = None
    format: Annotated[str, Setting(FORMAT, choices=FORMATS)] = "ply"
    batch_views: Annotated[int, Setting(BATCH, least=1)] = 1
    downscale: Downscale = 1
    max_primitives: Annotated[int | None, Setting("never hold more primitives than this", least=1)] = None
    max_world_scale: Annotated[float, Setting(WORLD_SCALE, least=1e-9)] = FROM_RECIPE
    split: Annotated[str, Setting(MEASURED, choices=SPLITS)] = "test"
    sh_degree: Annotated[int, Setting("highest degree of view-dependent colour, 0 to 3", least=0, most=3)] = 3
    background: Background = "auto"
    antialiased: Antialiased = False
    near_clip: Annotated[float | None, Setting(f"{NEAR} {USUAL_NEAR}", least=0, most=1e30)] = None
    near_zone: Annotated[float, Setting(NEAR_ZONE, least=0, most=1e30)] = 0.0
    masks: Annotated[str | None, Setting(MASKS, "FOLDER")] = None
    depths: Annotated[str | None, Setting(DEPTHS, "FOLDER")] = None
    white: Annotated[float | None, Setting(WHITE, "L", least=1e-30, most=1e30)] = None
    appearance: Annotated[bool, Setting(APPEARANCE)] = False
    refine_poses: Annotated[bool, Setting(REFINE_POSES)] = False
    preconditioned: Annotated[bool, Setting(PRECONDITIONED)] = False
    data_on_disk: Annotated[
        bool, Setting("decode each image shortly before it is needed, instead of holding all in memory")
    ] = False
    initial_primitives: Annotated[
        int, Setting("number of random primitives to start from if the data has no points", least=1)
    ] = 20_000
    seed: Annotated[int, Setting("seed of all random choices", least=0)] = 0
    variant: Annotated[str, Setting(VARIANT)] = "auto"
    log_every: Annotated[int, Setting("steps between rows of history.jsonl", least=1)] = 50
    test_every: Annotated[int, Setting(TESTS, least=0)] = 0
    memory: Annotated[str | None, Setting(MEMORY, "SIZE")] = None
    checkpoint_seconds: Annotated[float, Setting(CHECKPOINTS, least=0)] = 60.0
    up: Up = None
    scale: Length = None
    unit: Unit = None
    model: Annotated[
        str | None, Setting("start from this model, of whatever format and SH degree, at the pruning of the recipe")
    ] = None

    def __post_init__(self) -> None:
        check_settings(self)
        check_world(self.up, self.scale)
        self._fill_from_recipe()
        if self.format != "ply" and (rows := RECIPES[self.preset].given):
            problem = f'"{self.preset}" gives {rows} to primitives, and {self.format} does not hold them'
            refuse("preset", problem, "use ours, or --format ply")
        if self.memory is not None:
            try:
                bytes_of(self.memory)
            except ValueError as error:
                refuse("memory", str(error), "use a number with K, M, G or T, as 8G")
        self._check_target()

    @property
    def target_bytes(self) -> int | None:
        """Of the file that the training is to end with; None where the target is a ratio or a count."""
        return target_bytes(self.target)

    def require_pruning(self) -> None:
        """Raise ``DataError`` for a preset that does not prune, which meets no target."""
        if not RECIPES[self.preset].pruning:
            problem = f'{target_in_words(self.target)} needs pruning, and "{self.preset}" does not'
            refuse("target", problem, PRUNING_PRESETS)

    def _check_target(self) -> None:
        try:
            object.__setattr__(self, "target", checked_target(self.target))
        except ValueError as error:
            refuse("target", str(error), REMEDY)
        if self.target_bytes is not None:
            self.require_pruning()
        else:
            require_below_cap("target", float(self.target), self.max_primitives)

    def _fill_from_recipe(self) -> None:
        recipe = RECIPES[self.preset]
        if self.model is not None:
            if not recipe.pruning:
                refuse("preset", f'"{self.preset}" does not prune', PRUNING_PRESETS)
            if self.growth is not None:
                refuse("growth", "is for a training from the first step on", "leave it out for a model that exists")
            recipe = recipe.from_pruning()
        if self.steps is None:
            object.__setattr__(self, "steps", recipe.reference_steps)
        if self.max_world_scale is None:
            object.__setattr__(self, "max_world_scale", recipe.densification.max_world_scale)
