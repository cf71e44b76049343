"""What a training needs of memory, and how many primitives fit into what there is.

On a GPU it is the memory of the device, where neither Python nor the pictures are.

Measured on the CPU (LLVM, resident size; docs/trust.md has the table): within 10 % from 50,000 to 600,000 primitives.
F is the number of floats of a primitive: 14 without SH, 62 at degree 3 (``SplatOptimizer``). Rows of DoG,
slopes, curvatures, shifts and cuts and the products of preconditioned steps come when pruning is over: they count where
what is left then needs more than all primitives before.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..datasets import Dataset
from ..engine.bands import LISTED, WALKED
from ..engine.geometry import Blocks
from ..scene.row_groups import RowGroup
from ..support.device_memory import free_device_memory
from ..support.errors import DataError
from ..support.memory import available_memory, bytes_of
from ..support.wording import counted, file_size
from .events import MemoryFull
from .optimizer.trained_arrays import TrainedArrays

BASE = 230e6  # Python, Mitsuba, LLVM, kernels and, where none are kept from before, their compilation
TARGET = 40  # bytes per pixel of a training view: its planes on the device and what SSIM needs of them
BOUNDS = 12  # bytes per pixel of a training view that is saturated somewhere
MASK = 1  # byte per pixel of a training view that has one
DEPTH = 4  # bytes per pixel of a training view that has a depth map
AT_WORK = 150  # bytes per pixel of the view that is rendered: planes, what the loss is made of, gradients
TARGETS_SHARE = 0.25  # of the memory; if they need more, they are made when they are due, in a third of the loss's time
PER_FLOAT = 30  # bytes: value, two moments, gradient, what Adam is about to write; then the copy for a checkpoint
PER_PRODUCT = 12  # bytes: before and after a step, and the copy for a checkpoint
PER_PRIMITIVE = 400  # bytes: the projection and its derivative
MOST_BANDS = 8  # in which a view is walked, by an estimate: more take longer, and less memory still
ROWS_OF_BAND = 4  # of tiles, at least: bands of few rows differ in size
FIRST_PAIRS = 8.0  # pairs per primitive before any are counted
MARGIN = 0.85  # of the budget: the estimate is no better
# On a GPU, where Dr.Jit rounds the size of an array up to a power of two, and memory that is never touched counts:
ROUNDED = 1.9  # times what primitives need, at most (measured from 5,000 to a million)
DEVICE_PAIR = 60  # bytes: a pair of tile and primitive has no sums of its own there


@dataclass(frozen=True)
class Later:
    """What primitives get when pruning is over, and ``left``, the part of them that there are then."""

    groups: Collection[RowGroup] = ()  # rows
    products: int = 0  # of preconditioned steps
    left: float = 1.0

    @property
    def bytes(self) -> float:
        """Of a primitive."""
        return PER_FLOAT * floats_of(self.groups) + PER_PRODUCT * self.products


def floats_of(groups: Collection[RowGroup]) -> int:
    """In a row of each."""
    return sum(math.prod(shape) for group in groups for shape in group.arrays.values())


@dataclass
class Budget:
    """Memory for a training, in bytes. A *pair* is one of a tile and a primitive that touches it."""

    total: float
    base: float  # of the process, whatever is trained
    pictures: float  # and all that is made of them
    floats: int  # numbers of a primitive
    pair: float  # bytes, in a view of as many bands as it may be walked in before primitives are refused
    rounded: float = 1.0  # how many times arrays are as large as what is in them
    keep_targets: bool = True  # as in ``Photographs``
    pairs: int = 0  # the most that a view has had since the last refinement
    later: Later = Later()

    @property
    def fixed(self) -> float:
        """Bytes beside the primitives."""
        return self.base + self.pictures

    def each(self, pairs_per_primitive: float) -> float:
        """Bytes that a primitive needs, before the pruning or what is left of it after that."""
        now = self.rounded * (PER_FLOAT * self.floats + PER_PRIMITIVE) + self.pair * pairs_per_primitive
        return max(now, self.later.left * (now + self.rounded * self.later.bytes))

    def for_pairs(self, optimizer: TrainedArrays) -> float:
        """Bytes that primitives, with the rows and products that they have now, leave for pairs:
        ``RasterOptions.isect_memory``."""
        held = PER_FLOAT * optimizer.n_floats + PER_PRODUCT * optimizer.n_products + PER_PRIMITIVE * optimizer.n
        return MARGIN * self.total - self.fixed - held

    def most_primitives(self, pairs_per_primitive: float) -> int:
        """How many primitives fit."""
        return max(0, int((MARGIN * self.total - self.fixed) / self.each(pairs_per_primitive)))

    def give_back(self, n: int) -> None:
        """Give back what Dr.Jit keeps of arrays of earlier sizes, where ``n`` primitives make that worth it.

        It keeps them for arrays of the same size, which do not come again when the number of primitives has changed: a
        third of the memory of a model that grows.
        """
        if self.fixed + n * self.each(FIRST_PAIRS) > 0.5 * self.total:
            dr.flush_malloc_cache()

    def require(self, path: str, n: int, fewer: str) -> None:
        """Raise ``DataError`` unless training can start with ``n`` primitives; ``fewer``: how there would be less of
        them, as a remedy."""
        if self.most_primitives(FIRST_PAIRS) >= n:
            return
        primitives = n * self.each(FIRST_PAIRS)
        total = file_size((self.fixed + primitives) / MARGIN)
        need = f"training from {counted(n, 'primitive')} needs about {total} of memory"
        parts = f"pictures {file_size(self.pictures)}, primitives {file_size(primitives)}"
        remedy = f"use a larger --downscale, {fewer}, or a larger --memory"
        raise DataError(path, f"{need} ({parts}), and there are {file_size(self.total)}", remedy)

    def bounded(self, cap: int | None, n: int) -> tuple[int | None, MemoryFull | None]:
        """The cap of a refinement of ``n`` primitives, which does not outgrow the memory, and an event that says so.

        No event while the cap is far. The ``n`` that there are stay. Starts to count ``pairs`` anew.
        """
        most = max(n, self.most_primitives(self.pairs / n if self.pairs else FIRST_PAIRS))
        self.pairs = 0
        if cap is not None and cap <= most:
            return cap, None
        return most, MemoryFull(most, file_size(self.total)) if most < 2 * n else None


def budget(
    memory: str | None,
    dataset: Dataset,
    sh_degree: int,
    on_disk: bool = False,
    groups: Collection[RowGroup] = (),
    masked: bool = False,
    with_depths: bool = False,
    later: Later = Later(),  # noqa: B008, it is immutable
) -> Budget | None:
    """The budget of a training on the data; None where nobody knows how much memory there is.

    Args:
        memory: as ``TrainConfig.memory``; None is what the machine, or on a GPU the device, has to give now.
        on_disk: pictures and masks are decoded when they are due, and weigh nothing.
        groups: of which primitives have rows before any are pruned.
        masked: training views have masks.
        with_depths: they have depth maps.
        later: what comes when the pruning is over.
    """
    on_gpu = dr.backend_v(mi.Float) == dr.JitBackend.CUDA
    base = 0.0 if on_gpu else BASE
    pictures = 0 if on_disk or on_gpu else sum(view.n_bytes for view in dataset.views)
    total = _available(on_gpu, base + pictures) if memory is None else bytes_of(memory)
    if total is None:
        return None
    pixels = [view.camera.width * view.camera.height for view in dataset.train]
    targets = 0 if on_disk else TARGET * sum(pixels)
    keep_targets = targets <= TARGETS_SHARE * total
    if not keep_targets:
        targets = sum(view.n_bytes for view in dataset.train)
    masks = MASK * sum(pixels) if masked and not on_disk else 0
    depths = DEPTH * sum(pixels) if with_depths and not on_disk else 0
    bounds = 0 if on_disk else BOUNDS * sum(_saturated_sizes(dataset))
    at_work = (AT_WORK + (0 if keep_targets else TARGET)) * max(pixels)
    return Budget(
        total, base, pictures + targets + masks + depths + bounds + at_work,
        floats=14 + (3 * (sh_degree + 1) ** 2 if sh_degree else 0) + floats_of(groups),
        pair=DEVICE_PAIR if on_gpu else LISTED + WALKED / _bands(dataset),
        rounded=ROUNDED if on_gpu else 1.0,
        keep_targets=keep_targets, later=later,
    )  # fmt: skip


def _available(on_gpu: bool, held: float) -> float | None:
    """What there is for a training that ``held`` some already; None where nobody knows."""
    free = free_device_memory() if on_gpu else available_memory()
    return None if free is None else free + held


def _bands(dataset: Dataset) -> int:
    """In which the lowest view may be walked."""
    rows = min(view.camera.height for view in dataset.train) // Blocks.of_backend().tile_height
    return min(MOST_BANDS, max(1, rows // ROWS_OF_BAND))


def _saturated_sizes(dataset: Dataset) -> list[int]:
    """Pixels of each training view that is saturated somewhere."""
    views = dataset.train if dataset.white is not None else []
    return [view.camera.width * view.camera.height for view in views if view.recording.saturated is not None]
