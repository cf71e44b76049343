"""A tour in three steps, on a scene that ships: ``make demo``, or ``python -m mi_dogsplat.demo`` where installed."""
