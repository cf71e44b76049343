"""Every text of the add-on that Blender translates, with its context: what is registered, and what the code says.

Blender looks a text up by itself where it is a label, a tooltip, or the ``text=`` of a layout. All else is a template
that ``told`` or ``iface_`` looks up, or an error that does.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import bpy

import blender_addon
from blender_addon.panel import EDITED, SHOWN

ROOT = Path(blender_addon.__file__).parent
OPERATOR, REST = bpy.app.translations.contexts.operator_default, bpy.app.translations.contexts.default
OF_OPERATORS = ("operator", "operator_menu_enum", "menu")  # of a layout: the text has the operator's context
OF_LAYOUTS = (*OF_OPERATORS, "label", "prop", "prop_enum", "prop_menu_enum", "prop_search", "progress")
# What says something, and how many of the first arguments that is; of a report and a FileError the first is no text
SAID = {"iface_": 1, "tip_": 1, "told": 1, "note": 1, "ValueError": 1, "RendererError": 1, "report": 2, "FileError": 3}
TEMPLATES = ("report", "told", "note", *OF_LAYOUTS)
Text = tuple[str, str]  # context, text


def translatable() -> dict[Text, str]:
    """All of them, and where each is."""
    found: dict[Text, str] = {}
    of_classes = list(registered())
    names = {text for (_, text), _ in of_classes}
    handed = [(text, place) for text, place in of_functions() if text[1] not in names]
    for text, place in [*of_classes, *handed, *written()]:
        if any(letter.isalpha() or letter == '"' for letter in re.sub(r"{.*?}", "", text[1])):  # quotes have a language
            found.setdefault(text, place)
    return found


def registered() -> Iterator[tuple[Text, str]]:
    """Labels, tooltips, names and items of classes and of properties of scenes."""
    for cls in blender_addon.CLASSES:
        is_operator = issubclass(cls, bpy.types.Operator)
        if label := getattr(cls, "bl_label", ""):
            yield (OPERATOR if is_operator else REST, label), cls.__name__
        if is_operator:
            category, _, function = cls.bl_idname.partition(".")
            rna = getattr(getattr(bpy.ops, category), function).get_rna_type()
            yield (REST, rna.description), cls.__name__
        else:
            rna = cls.bl_rna
        own = {name for base in cls.__mro__ if ours(base) for name in getattr(base, "__annotations__", {})}
        for name in sorted(own & set(rna.properties.keys())):
            yield from of_property(rna.properties[name], f"{cls.__name__}.{name}")
    for name, item in bpy.types.Scene.bl_rna.properties.items():
        if name.startswith("dogsplat"):
            yield from of_property(item, f"Scene.{name}")
    for name in [*SHOWN, *(name for names in EDITED.values() for name in names)]:
        yield (REST, name), "panel.py"


def ours(base: type) -> bool:
    """A class of the add-on."""
    return base.__module__.split(".")[0] == blender_addon.__name__


def of_property(item: bpy.types.Property, place: str) -> Iterator[tuple[Text, str]]:
    """Its name, tooltip and items, unless it is hidden or has only its identifier."""
    if item.is_hidden or item.name == item.identifier:
        return
    yield (item.translation_context, item.name), place
    yield (REST, item.description), place
    for choice in getattr(item, "enum_items", ()):  # none where a function has them
        yield (item.translation_context, choice.name), place
        yield (REST, choice.description), place


def written() -> Iterator[tuple[Text, str]]:
    """Literals in the code, where they stand; a name stands for every literal that its file gives to it."""
    for path, tree in parsed():
        literals = given(tree)
        for call in calls(tree):
            for context, value in texts_of(call):
                for text in constants(value, literals):
                    yield (context, text), f"{path}:{call.lineno}"


def of_functions() -> Iterator[tuple[Text, str]]:
    """Items of enums in the code: beside those that are registered, what functions hand to Blender."""
    for path, tree in parsed():
        for item in items(tree):
            for value in item.elts[1:3]:
                for text in constants(value, {}):
                    yield (REST, text), f"{path}:{item.lineno}"


def items(tree: ast.Module) -> Iterator[ast.Tuple]:
    """Items of enums, which a function may hand to Blender: identifier in capitals, name, tooltip."""
    for node in (node for node in ast.walk(tree) if isinstance(node, ast.Tuple) and len(node.elts) in (3, 4, 5)):
        if all(isinstance(part, ast.Constant) and isinstance(part.value, str) for part in node.elts[:3]):
            identifier, name = (part.value for part in node.elts[:2])
            if identifier.isupper() and not name.isupper():
                yield node


def parsed() -> Iterator[tuple[Path, ast.Module]]:
    """Every file of the add-on, with its path inside."""
    for path in sorted(ROOT.rglob("*.py")):
        yield path.relative_to(ROOT), ast.parse(path.read_text(encoding="utf-8"))


def calls(tree: ast.Module) -> Iterator[ast.Call]:
    """Every call."""
    return (node for node in ast.walk(tree) if isinstance(node, ast.Call))


def given(tree: ast.Module) -> dict[str, list[ast.expr]]:
    """What is assigned to each name, tuples one by one."""
    found: dict[str, list[ast.expr]] = {}
    for node in (node for node in ast.walk(tree) if isinstance(node, ast.Assign)):
        for target in node.targets:
            pairs = [(target, node.value)]
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(target.elts, node.value.elts, strict=True))
            for name, value in pairs:
                if isinstance(name, ast.Name):
                    found.setdefault(name.id, []).append(value)
    return found


def constants(value: ast.expr, literals: dict[str, list[ast.expr]]) -> Iterator[str]:
    """The literals that an expression can be."""
    if isinstance(value, ast.Constant) and isinstance(value.value, str):
        yield value.value
    elif isinstance(value, ast.IfExp):
        yield from (text for part in (value.body, value.orelse) for text in constants(part, literals))
    elif isinstance(value, ast.Name):
        yield from (text for part in literals.get(value.id, ()) for text in constants(part, {}))


def texts_of(call: ast.Call) -> Iterator[tuple[str, ast.expr]]:
    """What a call says, with its context."""
    name = called(call)
    if name in OF_LAYOUTS:
        context = OPERATOR if name in OF_OPERATORS else REST
        yield from ((context, word.value) for word in call.keywords if word.arg == "text")
    elif name in SAID:
        yield from ((REST, value) for value in call.args[: SAID[name]])


def called(call: ast.Call) -> str:
    """The last name of what is called."""
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def formatted_too_early() -> Iterator[str]:
    """Places where what is said or drawn is an f-string, which no dictionary can have."""
    for path, tree in parsed():
        for call in calls(tree):
            values = [*call.args, *(word.value for word in call.keywords if word.arg == "text")]
            if called(call) in TEMPLATES and any(isinstance(value, ast.JoinedStr) for value in values):
                yield f"{path}:{call.lineno}"
