"""Small pictures: what is lost, and made up for, shows in them too."""

import pytest
from mi_dogsplat.export import refine
from mi_dogsplat.render import framing


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch):
    monkeypatch.setattr(refine, "VANTAGE_SIZE", (100, 75))
    monkeypatch.setattr(framing, "AUTOMATIC_SIZE", (200, 150))
