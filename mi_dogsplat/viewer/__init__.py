"""``dogsplat view``: a model, or a run while it trains, in the browser; every picture is rendered here."""
