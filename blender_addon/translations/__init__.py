"""The add-on in other languages than English: modules for the interface and the messages of each.

``bpy.app.translations`` looks up a text together with its context: that of operators for their labels and buttons, and
``*`` for all else. Where Blender has a translation of its own, such as for "Import", it takes that one. Properties for
which it has a wrong one, such as that of a sheet for "Paper", have the context ``OWN`` for their names and items.
"""

from __future__ import annotations

import bpy

from . import de_interface, de_messages, de_scene, de_training

OWN = "DoG Splat"

LANGUAGES = {
    "de": {
        "Operator": de_interface.OPERATORS,
        OWN: {**de_interface.OWN, **de_training.OWN},
        "*": {**de_interface.REST, **de_training.REST, **de_messages.MESSAGES, **de_scene.NOTES},
    },
}


def register(name: str) -> None:
    """Under the name of the add-on."""
    texts = {
        language: {(context, text): said for context, group in contexts.items() for text, said in group.items()}
        for language, contexts in LANGUAGES.items()
    }
    bpy.app.translations.register(name, texts)


def unregister(name: str) -> None:
    """The same backwards."""
    bpy.app.translations.unregister(name)
