"""German for every text of the add-on, and no text that is not there any more."""

from string import Formatter

import bpy
import pytest
from drawn_panels import drawn
from model_files import load
from translatable import formatted_too_early, translatable

from blender_addon.cameras.objects import camera_numbers
from blender_addon.panel import DOGSPLAT_PT_panel
from blender_addon.scene.export import Export
from blender_addon.scene.sockets import Reader
from blender_addon.translations import LANGUAGES

LANGUAGE = pytest.mark.parametrize("language", sorted(LANGUAGES))


@pytest.fixture
def german():
    """Blender's interface in German."""
    if not bpy.app.build_options.international:
        pytest.skip("this bpy is built without languages: run it in a whole Blender (docs/blender_details.md)")
    view = bpy.context.preferences.view
    view.language = "de_DE"
    view.use_translate_interface = view.use_translate_tooltips = view.use_translate_reports = True
    yield
    view.language = "en_US"


@LANGUAGE
def test_every_text_is_translated(language):
    contexts = LANGUAGES[language]
    missing = [f"{context}: {text!r}  ({place})" for (context, text), place in translatable().items()
               if text not in contexts[context]]  # fmt: skip
    assert not missing, f"to add to translations/{language}_*.py:\n" + "\n".join(missing)


@LANGUAGE
def test_every_translation_has_its_text(language):
    known = translatable()
    stale = [f"{context}: {text!r}" for context, texts in LANGUAGES[language].items() for text in texts
             if (context, text) not in known]  # fmt: skip
    assert not stale, f"to remove from translations/{language}_*.py:\n" + "\n".join(stale)


def test_what_is_shown_is_spelt_as_blender_spells_it():
    """Whatever comments say: labels such as "Colors" stand beside Blender's own."""
    assert not [text for _, text in translatable() if "colour" in text.lower()]


def test_what_is_put_in_stays_out_of_the_text():
    places = list(formatted_too_early())
    assert not places, (
        "write told(text, name=value), note(text, name=value) or iface_(text).format(name=value) in:\n"
        + "\n".join(places)
    )


@LANGUAGE
def test_a_translation_takes_what_its_text_takes(language):
    def fields(text):
        return sorted((name, form) for _, name, form, _ in Formatter().parse(text) if name is not None)

    for texts in LANGUAGES[language].values():
        for text, translation in texts.items():
            assert text.startswith("give {") or fields(text) == fields(translation), text
            assert translation.strip() == translation and not translation.endswith("."), text


def test_blender_speaks_german(german):
    say = bpy.app.translations
    for context, texts in LANGUAGES["de"].items():
        for text, translation in texts.items():
            assert say.pgettext(text, context) == translation, text  # Blender's own, where it has one, says the same
    assert say.pgettext_iface("Show As") == "Anzeigen als"
    assert say.pgettext_iface("Import DoG Splat", "Operator") == "DoG-Splat importieren"
    assert say.pgettext_tip(bpy.ops.dogsplat.join.get_rna_type().description).startswith("Die ausgewählten Modelle")


def test_errors_and_labels_are_german(german, model):
    with pytest.raises(RuntimeError, match=r"nichts.ply: kann nicht gelesen werden \(.*\); den Pfad und seine Rechte"):
        bpy.ops.import_scene.dogsplat(filepath="nichts.ply")
    load(model)
    assert "dog: 150 Splats" in drawn()
    assert DOGSPLAT_PT_panel.bl_label == "DoG Splat"


def test_notes_about_a_scene_are_german(german, scene, tmp_path):
    export = Export(tmp_path)
    Reader(export, "Wand").note("its volume is left out")
    assert export.notes == ["„Wand“: sein Volumen wird weggelassen"]
    data = bpy.data.cameras.new("Plan")
    data.type = "ORTHO"
    with pytest.raises(ValueError, match="„Plan“ hat den Typ „Orthografisch“"):
        camera_numbers(scene, bpy.data.objects.new("Plan", data))


def test_english_comes_back_without_the_add_on(german):
    import addon_utils

    addon_utils.disable("blender_addon")
    assert bpy.app.translations.pgettext_iface("Show As") == "Show As"
    addon_utils.enable("blender_addon")
    assert bpy.app.translations.pgettext_iface("Show As") == "Anzeigen als"
