"""Tasks of a comparison performed in this process, whose kernels are compiled already."""

from mi_dogsplat.compare.execute import Means
from mi_dogsplat.compare.tasks import Task, perform


def perform_here(task: Task, means: Means) -> None:
    """In place of ``execute.in_a_process``; what goes wrong is raised."""
    perform(task, means.free)
