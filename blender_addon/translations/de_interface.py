"""German labels and tooltips, in the order of the interface; the panel of training has a file of its own."""

OPERATORS = {
    "Import DoG Splat": "DoG-Splat importieren",
    "Import": "Importieren",
    "DoG Splat (.ply)": "DoG-Splat (.ply)",
    "DoG Splat (.ply/.spz/.sog/.glb/.usd)": "DoG-Splat (.ply/.spz/.sog/.glb/.usd)",
    "Import DoG Splat Cameras": "DoG-Splat-Kameras importieren",
    "Import Cameras": "Kameras importieren",
    "DoG Splat Cameras (COLMAP, transforms.json, run)": "DoG-Splat-Kameras (COLMAP, transforms.json, Training)",
    "Look Through Camera": "Durch Kamera schauen",
    "Import DoG Splat Camera Path": "DoG-Splat-Kamerapfad importieren",
    "DoG Splat Camera Path (.json, of dogsplat film)": "DoG-Splat-Kamerapfad (.json, von dogsplat film)",
    "Export DoG Splat Camera Path": "DoG-Splat-Kamerapfad exportieren",
    "DoG Splat Camera Path (.json, for dogsplat film)": "DoG-Splat-Kamerapfad (.json, für dogsplat film)",
    "Export DoG Splat": "DoG-Splat exportieren",
    "Export": "Exportieren",
    "Add Crop": "Zuschnitt hinzufügen",
    "Add Limits": "Grenzen hinzufügen",
    "Paint Splats": "Splats bemalen",
    "Paint": "Malen",
    "Finish Painting": "Malen beenden",
    "Apply Edits": "Bearbeitungen anwenden",
    "Edits of Splats": "Bearbeitungen von Splats",
    "Join Splats": "Splats zusammenführen",
    "Apply Transform to Splats": "Transformation auf Splats anwenden",
    "All Transforms to Splats": "Alle Transformationen auf Splats",
    "Surface Mesh": "Oberflächen-Mesh",
    "Stop": "Anhalten",
    "Convert to Native": "In Blenders eigene umwandeln",
    "Convert to DoG Splat": "In DoG-Splat umwandeln",
    "Set Up Exact Picture": "Exaktes Bild einrichten",
    "Make Cameras": "Kameras erzeugen",
    "Render Views": "Ansichten rendern",
    "Go On Rendering": "Weiter rendern",
    "Render and Train": "Rendern und trainieren",
    "Go On Rendering, and Train": "Weiter rendern und trainieren",
    "Train": "Trainieren",
    "Train Anew": "Neu trainieren",
    "Go On Training": "Weiter trainieren",
    "Stop Training": "Training anhalten",
}

# What Blender would say otherwise: it has other words for some of these
OWN = {
    "Scale": "Skalierung",
    "Set Frame Range": "Bildbereich setzen",
    "Shape": "Form",
    "Box": "Quader",
    "Sphere": "Kugel",
    "Mesh": "Mesh",
}

REST = {
    # Names that stay as they are
    "DoG Splat": "DoG Splat",
    "DoG Splat (Mitsuba)": "DoG Splat (Mitsuba)",
    "DoG": "DoG",
    "Splats": "Splats",
    "Linear": "Linear",
    "Z": "Z",
    "-Z": "-Z",
    "Y": "Y",
    "-Y": "-Y",
    # Import
    "Import 3D Gaussian and Difference-of-Gaussians models (PLY and SPZ; with the package glTF, USD and others too)": (
        "Modelle aus 3D-Gauß-Splats und Differenzen von Gauß-Funktionen importieren (PLY und SPZ; mit dem Paket auch "
        "glTF, USD und andere)"
    ),
    "Up Axis": "Oben-Achse",
    "Which axis of the file is up": "Welche Achse der Datei nach oben zeigt",
    "Which axis of the file is up; unless set here, as the file says": (
        "Welche Achse der Datei nach oben zeigt; wenn hier nicht eingestellt, wie die Datei es sagt"
    ),
    "As in the file: for Blender, Mitsuba and instant-ngp scenes": (
        "Wie in der Datei: für Szenen von Blender, Mitsuba und instant-ngp"
    ),
    "Turned upside down": "Auf den Kopf gestellt",
    "For models with y up, as many viewers use": "Für Modelle mit y nach oben, wie viele Betrachter sie verwenden",
    "For models with y down, as COLMAP without orientation makes them": (
        "Für Modelle mit y nach unten, wie COLMAP sie ohne Ausrichtung erzeugt"
    ),
    "Unless set here, as the file says": "Wenn hier nicht eingestellt, wie die Datei es sagt",
    "Upright, in Metres": "Aufrecht, in Metern",
    "Turn and scale as the file says; else only as it is set here": (
        "Drehen und skalieren, wie die Datei es sagt; sonst nur, wie es hier eingestellt ist"
    ),
    "SH Degree": "SH-Grad",
    "View-dependent color up to this band; higher ones are not loaded": (
        "Blickabhängige Farbe bis zu diesem Band; höhere werden nicht geladen"
    ),
    "Minimum Opacity": "Kleinste Deckkraft",
    "Splats of a lower opacity are not loaded": "Splats mit geringerer Deckkraft werden nicht geladen",
    "Maximum Count": "Höchste Anzahl",
    "Load only the most important splats, by opacity and size; 0 loads all": (
        "Nur die wichtigsten Splats laden, nach Deckkraft und Größe; 0 lädt alle"
    ),
    "Subtract the pseudo-Gaussians of DoG models": "Die Pseudo-Gauß-Funktionen von DoG-Modellen abziehen",
    "Colors": "Farben",
    "Scene": "Szene",
    "Linear light: right under Standard, Filmic and AgX, together with other objects": (
        "Lineares Licht: richtig unter Standard, Filmic und AgX, zusammen mit anderen Objekten"
    ),
    "Exact": "Exakt",
    "sRGB values blended as trained: the exact picture, for the view transform Raw": (
        "sRGB-Werte, gemischt wie im Training: das exakte Bild, für die Ansichtstransformation Raw"
    ),
    "Show As": "Anzeigen als",
    "Automatic": "Automatisch",
    "Quads in renders, ellipsoids in the viewport": "Vierecke beim Rendern, Ellipsoide im Ansichtsfenster",
    "Quads": "Vierecke",
    "Exact for the active camera, meaningless from elsewhere": (
        "Exakt für die aktive Kamera, von anderswo ohne Bedeutung"
    ),
    "Ellipsoids": "Ellipsoide",
    "Instances that are right from everywhere": "Instanzen, die von überall richtig aussehen",
    "Points": "Punkte",
    "A point cloud: opaque and fast": "Eine Punktwolke: deckend und schnell",
    "Antialiased": "Mit Antialiasing",
    "For models that were trained with antialiasing; unless set here, as the file says": (
        "Für Modelle, die mit Antialiasing trainiert wurden; wenn hier nicht eingestellt, wie die Datei es sagt"
    ),
    "Prepare Viewports": "Ansichtsfenster vorbereiten",
    "Material preview for solid shading, and no outlines of selected objects: both hide splats": (
        "Schattierung „Materialbeispiel“ statt „Massiv“, und keine „Auswahlumrandung“: beides verdeckt Splats"
    ),
    # Cameras
    "Import the cameras of a data set (COLMAP, transforms.json) or of a run folder": (
        "Die Kameras eines Datensatzes (COLMAP, transforms.json) oder eines Trainingsordners importieren"
    ),
    "Follow the Model": "Dem Modell folgen",
    "Place the cameras as the active model of splats is placed, whatever the up axis and scale below": (
        "Die Kameras so platzieren wie das aktive Splat-Modell, unabhängig von Oben-Achse und Skalierung darunter"
    ),
    "Downscale": "Verkleinern",
    "Size of the pictures as a fraction of the photographs; 0: as the run was trained, else 1": (
        "Größe der Bilder als Bruchteil der Fotografien; 0: wie im Training, sonst 1"
    ),
    "Background Images": "Hintergrundbilder",
    "Show each photograph behind its camera": "Jede Fotografie hinter ihrer Kamera anzeigen",
    "Look Through the First": "Durch die erste schauen",
    "Make the first camera active and set the resolution of the render to its": (
        "Die erste Kamera zur aktiven machen und die Auflösung des Renderings auf ihre setzen"
    ),
    "Make the selected camera active, with the resolution and pixel aspect of its photograph": (
        "Die ausgewählte Kamera zur aktiven machen, mit Auflösung und Pixelseitenverhältnis ihrer Fotografie"
    ),
    "Import the key frames of dogsplat film as an animated camera": (
        "Die Schlüsselbilder von dogsplat film als animierte Kamera importieren"
    ),
    "Let the frames of the scene begin and end with the path": (
        "Die Einzelbilder der Szene mit dem Pfad beginnen und enden lassen"
    ),
    "Export the scene's camera, frame by frame, in the coordinates of the model: for dogsplat film --path": (
        "Die Kamera der Szene Bild für Bild in den Koordinaten des Modells exportieren: für dogsplat film --path"
    ),
    "Step": "Schritt",
    "Frames from one key to the next": "Einzelbilder von einem Schlüsselbild zum nächsten",
    # Export
    "Export the selected splats as one PLY with its DoG data; what nobody changed keeps the bits of its file": (
        "Die ausgewählten Splats als ein PLY mit DoG-Daten exportieren; was niemand geändert hat, behält die Bits "
        "seiner Datei"
    ),
    "Coordinates": "Koordinaten",
    "Of the File": "Der Datei",
    "Undo the up axis and scale of the import, keep what was moved since then": (
        "Oben-Achse und Skalierung des Imports rückgängig machen, behalten, was seitdem bewegt wurde"
    ),
    "Of the Scene": "Der Szene",
    "As the splats stand in Blender, z up": "Wie die Splats in Blender stehen, z nach oben",
    "Hidden Splats": "Verborgene Splats",
    "Write the objects as if no crop, limit or painting were there; off: only what these show": (
        "Die Objekte schreiben, als gäbe es keinen Zuschnitt, keine Grenzen und keine Bemalung; aus: nur, was diese "
        "zeigen"
    ),
    # Editing
    "Edit Splats": "Splats bearbeiten",
    "Keep the splats inside of a new object, which can be moved and animated; nothing is deleted. "
    "Mesh takes another selected mesh, as a wire frame that renders do not show": (
        "Die Splats in einem neuen Objekt behalten, das bewegt und animiert werden kann; nichts wird gelöscht. Mesh "
        "nimmt ein anderes ausgewähltes Mesh, als Drahtgitter, das beim Rendern nicht erscheint"
    ),
    "Shape": "Form",
    "Object": "Objekt",
    "Invert": "Invertieren",
    "Keep what is outside": "Behalten, was außerhalb ist",
    "Sliders for the opacity, the size and the number of the splats that stay; nothing is deleted": (
        "Regler für Deckkraft, Größe und Anzahl der Splats, die bleiben; nichts wird gelöscht"
    ),
    "Minimum Size": "Kleinste Größe",
    "Maximum Size": "Höchste Größe",
    "Count By": "Zählen nach",
    "Paint on the splats with Blender's brushes, by a stand-in that has faces: weights erase, colors tint": (
        "Mit Blenders Pinseln auf die Splats malen, über einen Stellvertreter mit Flächen: Gewichte radieren, Farben "
        "tönen"
    ),
    "What": "Was",
    "Erase": "Radieren",
    "Weight paint: splats with a weight above the threshold are left out": (
        "Gewichtsmalerei: Splats mit einem Gewicht über dem Schwellwert werden weggelassen"
    ),
    "Tint": "Tönung",
    "Vertex paint: colors are multiplied by what is painted": (
        "Vertexmalerei: Farben werden mit dem Gemalten multipliziert"
    ),
    "Threshold": "Schwellwert",
    "Store what was painted with the splats and remove the stand-in; painting can go on later": (
        "Das Gemalte bei den Splats speichern und den Stellvertreter entfernen; gemalt werden kann später weiter"
    ),
    "Delete the splats that crop, limits and painting hide, and make their tints part of the colors": (
        "Die Splats löschen, die Zuschnitt, Grenzen und Bemalung verbergen, und Tönungen in die Farben übernehmen"
    ),
    "Join the selected models into the active one, edits applied; missing bands of color become zero": (
        "Die ausgewählten Modelle mit dem aktiven zusammenführen, Bearbeitungen angewandt; fehlende Farbbänder werden "
        "null"
    ),
    "Make the object's transform part of its splats: positions, orientations, sizes and view-dependent colors": (
        "Die Transformation des Objekts in seine Splats übernehmen: Positionen, Ausrichtungen, Größen und "
        "blickabhängige Farben"
    ),
    # Surface meshes
    "Surface Mesh": "Oberflächen-Mesh",
    "Make a mesh of the surface that the active splats show: a proxy for collisions, rigid bodies and shadows": (
        "Ein Mesh der Oberfläche erzeugen, die die aktiven Splats zeigen: ein Stellvertreter für Kollisionen, "
        "Starrkörper und Schatten"
    ),
    "Voxel Size": "Voxelgröße",
    "How fine the mesh is, in units of the object, as for Blender's Remesh; 0 is automatic": (
        "Wie fein das Mesh ist, in Einheiten des Objekts, wie bei Blenders Remesh; 0 ist automatisch"
    ),
    "Most Triangles": "Höchstens Dreiecke",
    "Simplify the mesh to so many; 0 keeps all of them": "Das Mesh auf so viele vereinfachen; 0 behält alle",
    "Texture Size": "Texturgröße",
    "Colors in a picture of so many pixels along its side; 0: one color for each vertex": (
        "Farben in einem Bild von so vielen Pixeln Seitenlänge; 0: eine Farbe je Vertex"
    ),
    "Largest Part Only": "Nur der größte Teil",
    "Leave out all that does not hang together with it": "Alles weglassen, was nicht mit ihm zusammenhängt",
    "For a Room": "Für einen Raum",
    "Look at the splats from within alone, not from around them": (
        "Die Splats nur von innen betrachten, nicht von außen herum"
    ),
    "Rigid Body": "Starrkörper",
    "A passive one, which others collide with, of the shape of the mesh": (
        "Ein passiver, mit dem andere zusammenstoßen, von der Form des Meshs"
    ),
    "Give up the surface that is being made": "Die Oberfläche aufgeben, die gerade entsteht",
    # Rendering
    "Set view transform, sampling and filter of this scene, and the colors of its models, for the exact picture": (
        "Ansichtstransformation, Abtastung und Filter dieser Szene und die Farben ihrer Modelle für das exakte Bild "
        "setzen"
    ),
    "Samples": "Abtastwerte",
    "1 looks at pixel centres, as splatting does; more smooths the edges of other objects": (
        "1 betrachtet die Pixelmitten, wie beim Splatting; mehr glättet die Kanten anderer Objekte"
    ),
    "Render": "Rendern",
    "Whole Scene": "Ganze Szene",
    "Splats together with meshes, lights, world and materials, path traced": (
        "Splats zusammen mit Meshes, Lichtern, Welt und Materialien, mit Path Tracing"
    ),
    "Splats Only": "Nur Splats",
    "The exact picture of the splats over the color of the world": (
        "Das exakte Bild der Splats über der Farbe der Welt"
    ),
    "Paths per pixel of a whole scene": "Pfade je Pixel einer ganzen Szene",
    "Denoise": "Entrauschen",
    "Smooth the noise of a whole scene when its samples are done; splats in front stay sharp": (
        "Glättet das Rauschen einer ganzen Szene, wenn ihre Samples fertig sind; Splats im Vordergrund bleiben scharf"
    ),
    "Bounces": "Reflexionen",
    "Of light, in a whole scene": "Des Lichts, in einer ganzen Szene",
    "Shadows on Splats": "Schatten auf Splats",
    "Meshes darken the splats that they hide from the lights of the scene: an approximation": (
        "Meshes verdunkeln die Splats, die sie vor den Lichtern der Szene verbergen: eine Näherung"
    ),
    "Colors of Splats Only": "Farben bei „Nur Splats“",
    "Scene-linear radiance: the exact picture under the view transform Standard": (
        "Szenenlineare Strahldichte: das exakte Bild unter der Ansichtstransformation Standard"
    ),
    "Display": "Anzeige",
    "sRGB values: the exact picture under the view transform Raw": (
        "sRGB-Werte: das exakte Bild unter der Ansichtstransformation Raw"
    ),
    "Passes": "Durchgänge",
    "Override": "Überschreibung",
    "Film": "Film",
    "Ray Visibility": "Strahlensichtbarkeit",
    "Camera": "Kamera",
    # Viewport
    "Linear Colors": "Lineare Farben",
    "Near Clip": "Nahe Schnittebene",
    "Viewport Share": "Anteil im Ansichtsfenster",
    "While Moving": "Beim Bewegen",
    "What a viewport shows while it moves": "Was ein bewegtes Ansichtsfenster zeigt",
    "Points where a processor draws, else the most important splats": (
        "Punkte, wo ein Prozessor zeichnet, sonst die wichtigsten Splats"
    ),
    "The most important splats as points, in coarse pixels: for processors": (
        "Die wichtigsten Splats als Punkte, in groben Pixeln: für Prozessoren"
    ),
    "Most Important": "Wichtigste",
    "The most important splats, as they are shown": "Die wichtigsten Splats, wie sie angezeigt werden",
    "All": "Alle",
    "All splats": "Alle Splats",
    "Splats While Moving": "Splats beim Bewegen",
    "A viewport that moves shows so many splats, the most important ones": (
        "Ein bewegtes Ansichtsfenster zeigt so viele Splats, die wichtigsten"
    ),
    "Follow View": "Ansicht folgen",
    "Make colors, and the quads of Automatic, for the viewport that moved last instead of the camera; renders stay "
    "with the camera": (
        "Farben, und die Vierecke von „Automatisch“, für das zuletzt bewegte Ansichtsfenster statt für die Kamera "
        "erzeugen; gerendert wird weiterhin für die Kamera"
    ),
    "Working space changed: import the model again": "Arbeitsfarbraum geändert: das Modell neu importieren",
    "Blender draws colors of another working space": "Blender zeigt Farben eines anderen Arbeitsfarbraums",
    "Solid shading has no colors": "Massive Schattierung hat keine Farben",
    "Material Preview": "Materialbeispiel",
    "Outline Selected": "Auswahlumrandung",
    "Colors need an active camera, or Follow View": "Farben brauchen eine aktive Kamera oder „Ansicht folgen“",
    "EEVEE: no negative lobes": "EEVEE: keine negativen Keulen",
    "Multi-View: quads of the active camera": "Multi-View: Vierecke der aktiven Kamera",
    "EEVEE: join models that overlap": "EEVEE: Modelle zusammenführen, die sich überschneiden",
    "Blender draws mean colors, no slopes": "Blender zeichnet mittlere Farben, keine Verläufe",
    "Blender draws mean brightness, no curvatures": "Blender zeichnet mittlere Helligkeit, keine Krümmungen",
    "Blender draws whole splats, no cuts": "Blender zeichnet ganze Splats, keine Schnitte",
    "Blender draws mean places, no shifts": "Blender zeichnet mittlere Orte, keine Verschiebungen",
    "No splat modifier: import the model again": "Kein Splat-Modifikator: Modell neu importieren",
    "{name}: {count:,} splats": "{name}: {count:,} Splats",
    # Native splats
    "Native": "Blenders eigene",
    "Drawn by Blender itself in real time, as plain Gaussians: the package bakes DoG into them": (
        "Von Blender selbst in Echtzeit gezeichnet, als einfache Gauß-Splats: das Paket rechnet DoG in sie ein"
    ),
    "Let Blender draw the selected splats itself, as plain Gaussians; what crop, limits and painting hide is gone": (
        "Blender die ausgewählten Splats selbst zeichnen lassen, als einfache Gauß-Splats; was Zuschnitt, Grenzen und "
        "Malen verbergen, fällt weg"
    ),
    "Let our modifier draw the selected native splats: exactly, with their DoG, and with what was edited since": (
        "Den Modifikator des Add-ons die ausgewählten Splats zeichnen lassen: exakt, mit ihren DoG und mit allem, was "
        "seither bearbeitet wurde"
    ),
    "Keep Original": "Original behalten",
    "Leave the object that is converted in the file, hidden": (
        "Das Objekt, das umgewandelt wird, verborgen in der Datei lassen"
    ),
    "{name}: plain Gaussians, by Blender": "{name}: einfache Gauß-Splats, von Blender",
    # Preferences
    "Command dogsplat": "Befehl dogsplat",
    "Of the package mi_dogsplat, or words: python -m mi_dogsplat. Empty: this Python, else the PATH": (
        "Des Pakets mi_dogsplat, oder Wörter: python -m mi_dogsplat. Leer: dieses Python, sonst der PATH"
    ),
    "Splats Follow Their Points": "Splats folgen ihren Punkten",
    "Turn and scale splats with vertices that Apply Transform, Join or edit mode moved": (
        "Splats mit Punkten drehen und skalieren, die „Transformation anwenden“, „Zusammenführen“ oder der "
        "Bearbeitungsmodus bewegt hat"
    ),
}
