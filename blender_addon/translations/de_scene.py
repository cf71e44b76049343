"""German notes about a scene: what Mitsuba draws differently, or not at all."""

NOTES = {
    '"{name}" is left out': "„{name}“ wird weggelassen",
    '"{name}" is left out ({kind})': "„{name}“ wird weggelassen ({kind})",
    '"{name}": its modifier "{modifier}" comes after the one that draws and changes no splats; move it in front': (
        "„{name}“: sein Modifikator „{modifier}“ kommt nach dem, der zeichnet, und ändert keine Splats; davor schieben"
    ),
    '"{name}": its nodes copy what draws splats, which is left out; turn on As Instance there, and realize nothing': (
        "„{name}“: seine Nodes kopieren, was Splats zeichnet, was weggelassen wird; dort „Als Instanz“ einschalten und "
        "nichts realisieren"
    ),
    '"{name}": its splats are left out, as it is scaled to nothing along an axis': (
        "„{name}“: seine Splats werden weggelassen, da es entlang einer Achse auf nichts skaliert ist"
    ),
    "all splats are hidden from this picture": "alle Splats sind in diesem Bild verborgen",
    '"{name}": the picture of the camera is drawn without the shear of its parents; apply their scale': (
        "„{name}“: das Bild der Kamera wird ohne die Scherung durch ihre Eltern gezeichnet; deren Skalierung anwenden"
    ),
    '"{name}": a sheet of glass changes the brightness of what is behind it; give it thickness, as by Solidify': (
        "„{name}“: Glas ohne Dicke ändert die Helligkeit dessen, was dahinter ist; ihm eine Dicke geben, etwa durch "
        "„Solidify“"
    ),
    "motion blur is left out": "Bewegungsunschärfe wird weggelassen",
    "depth of field is left out; it needs Whole Scene and Linear colors": (
        "Schärfentiefe wird weggelassen; dazu braucht es „Ganze Szene“ und lineare Farben"
    ),
    "depth of field is left out; it needs a perspective camera": (
        "Schärfentiefe wird weggelassen; dazu braucht es eine perspektivische Kamera"
    ),
    "the aperture is round, whatever its blades and ratio": (
        "die Blende ist rund, unabhängig von ihren Lamellen und ihrem Verhältnis"
    ),
    '"{name}": a shadow catcher is drawn as any other object': (
        "„{name}“: ein Schattenfänger wird wie jedes andere Objekt gezeichnet"
    ),
    '"{name}": of Ray Visibility, only Camera has an effect': (
        "„{name}“: von der Strahlensichtbarkeit wirkt nur „Kamera“"
    ),
    # Lights and the world
    "the view layer's override of the world is left out": (
        "die Überschreibung der Welt durch die Ansichtsebene wird weggelassen"
    ),
    "the view layer's filter is left out: environment and surfaces are drawn": (
        "der Filter der Ansichtsebene wird weggelassen: Umgebung und Oberflächen werden gezeichnet"
    ),
    '"{light}": the shadows of a spot are sharp': "„{light}“: die Schatten eines Spots sind scharf",
    '"{light}": a light of negative power is left out': "„{light}“: ein Licht negativer Leistung wird weggelassen",
    '"{light}": an area light shines to all sides, whatever its spread': (
        "„{light}“: ein Flächenlicht leuchtet nach allen Seiten, unabhängig von seiner Streuung"
    ),
    'the node "{node}" has no counterpart in Mitsuba; the world has its viewport color': (
        "der Node „{node}“ hat kein Gegenstück in Mitsuba; die Welt hat ihre Farbe im Ansichtsfenster"
    ),
    'the node "{node}" has no counterpart in Mitsuba; it shines as without nodes': (
        "der Node „{node}“ hat kein Gegenstück in Mitsuba; es leuchtet wie ohne Nodes"
    ),
    "the nodes of the world are left out; behind splats alone is its viewport color": (
        "die Nodes der Welt werden weggelassen; hinter Splats allein ist ihre Farbe im Ansichtsfenster"
    ),
    "the picture of the world is treated as equirectangular": "das Bild der Welt wird als äquirektangular verstanden",
    'the picture of the world is looked up by directions, instead of "{node}"': (
        "das Bild der Welt wird nach Richtungen nachgeschlagen, statt nach „{node}“"
    ),
    'of the mapping "{mapping}" only the rotation is drawn': "vom Mapping „{mapping}“ wird nur die Drehung gezeichnet",
    'the mapping "{mapping}" is left out': "das Mapping „{mapping}“ wird weggelassen",
    # Materials
    "its displacement is left out": "sein Displacement wird weggelassen",
    '"{name}": its light linking is left out': "„{name}“: sein Light Linking wird weggelassen",
    '"{name}": its hair is left out': "„{name}“: seine Haare werden weggelassen",
    '"{light}": a light without shadows casts shadows here': "„{light}“: ein Licht ohne Schatten wirft hier Schatten",
    "its Ray Visibility is ignored": "ihre Strahlensichtbarkeit wird nicht beachtet",
    "its volume is left out": "sein Volumen wird weggelassen",
    'the shader "{node}" has no counterpart in Mitsuba; drawn in the color of the viewport': (
        "der Shader „{node}“ hat kein Gegenstück in Mitsuba; gezeichnet in der Farbe des Ansichtsfensters"
    ),
    "light of a mixture by a texture is left out": "das Licht einer Mischung nach einer Textur wird weggelassen",
    "of two shaders that are added the first is kept": "von zwei addierten Shadern bleibt der erste",
    "a transparent shader that is added to another is left out": (
        "ein transparenter Shader, der zu einem anderen addiert wird, wird weggelassen"
    ),
    "colors above 1 are drawn as 1": "Farben über 1 werden als 1 gezeichnet",
    "of two lights the first is kept": "von zwei Lichtern bleibt das erste",
    "the texture colors what is seen through it at each of its two surfaces": (
        "die Textur färbt, was durch sie zu sehen ist, an jeder der beiden Oberflächen"
    ),
    'the node "{node}" does not bend normals in Mitsuba': "der Node „{node}“ verbiegt in Mitsuba keine Normalen",
    "its normal map has the strength 1": "seine Normal-Map hat die Stärke 1",
    "its coat has the normals of what is below it": "seine Beschichtung hat die Normalen dessen, was darunter ist",
    # Textures
    'the image "{image}" has no pixels; it is left out': "das Bild „{image}“ hat keine Pixel; es wird weggelassen",
    'of the tiles of the image "{image}" only one is drawn': (
        "von den Kacheln des Bildes „{image}“ wird nur eine gezeichnet"
    ),
    'of the frames of the image "{image}" only one is drawn': (
        "von den Einzelbildern des Bildes „{image}“ wird nur eines gezeichnet"
    ),
    'the image "{image}" is drawn as one in {drawn}, not in {space}': (
        "das Bild „{image}“ wird wie eines in {drawn} gezeichnet, nicht in {space}"
    ),
    'the image of "{node}" is not projected, but laid by texture coordinates': (
        "das Bild von „{node}“ wird nicht projiziert, sondern nach Texturkoordinaten gelegt"
    ),
    'the texture of "{socket}" is left out': "die Textur von „{socket}“ wird weggelassen",
    'the node "{node}" has no counterpart in Mitsuba; its socket keeps its own value': (
        "der Node „{node}“ hat kein Gegenstück in Mitsuba; sein Eingang behält den eigenen Wert"
    ),
    'the image of "{node}" is repeated at its edges, not cut off': (
        "das Bild von „{node}“ wird an den Rändern wiederholt, nicht abgeschnitten"
    ),
    '"{image}" takes the texture coordinates of the mesh, instead of "{node}"': (
        "„{image}“ nimmt die Texturkoordinaten des Meshs statt „{node}“"
    ),
    'what "{socket}" of a mapping is linked to is left out': (
        "womit „{socket}“ eines Mappings verbunden ist, wird weggelassen"
    ),
}
