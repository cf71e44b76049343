"""Fog, smoke and other media, which light paths do not see."""

from __future__ import annotations

from typing import Any

import mitsuba as mi


def warn_of_media(name: str, scene: mi.Scene) -> None:
    """A warning of Mitsuba's logger, in the ``name`` of a plugin, where shapes bound media or a sensor is in one."""
    around = any(sensor.get_medium() is not None for sensor in scene.sensors())
    if around or any(shape.is_medium_transition() for shape in scene.shapes()):
        log: Any = mi.Log
        remedy = "dogsplat, with volpath nested, shows those before surfaces"
        log(mi.LogLevel.Warn, f"{name}: light passes through fog and other media as through empty space; {remedy}")
