"""How much of the training photographs the masks of a run hide, and a sheet of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..datasets.masks import MOSTLY
from ..support.wording import finite
from .pictures import embedded_jpeg, read_pictures
from .run_folder import MASKED, Run


@dataclass(frozen=True)
class Masked:
    """Of ``n_views`` training photographs ``n_masked`` are masked in part; ``percent`` of their pixels, on average over
    all; more than half of those that are ``named``. ``source`` of the sheet is that of an image element, or empty."""

    n_views: int
    n_masked: int
    percent: float
    named: Sequence[str]
    source: str


def masked(run: Run) -> Masked | None:
    """What metrics.json says of masks; None where a run had none."""
    known = ((name, finite(share)) for name, share in ((run.metrics or {}).get("masked") or {}).items())
    shares = {name: share for name, share in known if share is not None}
    if not shares:
        return None
    sheet = read_pictures({"": run.path / MASKED})[0].get("")
    return Masked(
        len(shares),
        sum(share > 0 for share in shares.values()),
        100 * sum(shares.values()) / len(shares),
        sorted(name for name, share in shares.items() if share > MOSTLY),
        "" if sheet is None else embedded_jpeg(sheet),
    )
