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
    "Import models of 3D Gaussians and Differences of Gaussians: PLY and SPZ, with the package glTF and others, too": (
        "Modelle aus 3D-Gauß-Splats und Differenzen von Gauß-Funktionen importieren: PLY und SPZ, mit dem Paket "
        "auch glTF und andere"
    ),
    "Up Axis": "Oben-Achse",
    "Which axis of the file points up": "Welche Achse der Datei nach oben zeigt",
    "Which axis of the file points up. If it is not set here, the file decides": (
        "Welche Achse der Datei nach oben zeigt. Ist sie hier nicht eingestellt, entscheidet die Datei"
    ),
    "As in the file: for Blender, Mitsuba and instant-ngp scenes": (
        "Wie in der Datei: für Szenen von Blender, Mitsuba und instant-ngp"
    ),
    "Turned upside down": "Auf den Kopf gestellt",
    "For models with y up, as many viewers use": "Für Modelle mit y nach oben, wie viele Betrachter sie verwenden",
    "For models with y down, as COLMAP without orientation makes them": (
        "Für Modelle mit y nach unten, wie COLMAP sie ohne Ausrichtung erzeugt"
    ),
    "If it is not set here, the file decides": "Ist sie hier nicht eingestellt, entscheidet die Datei",
    "Upright, in Metres": "Aufrecht, in Metern",
    "Rotate and scale as the file says. If off, only as set here": (
        "Drehen und skalieren, wie die Datei es sagt. Wenn aus, nur, wie es hier eingestellt ist"
    ),
    "SH Degree": "SH-Grad",
    "Highest degree of view-dependent color that is loaded": (
        "Höchster Grad der blickabhängigen Farbe, der geladen wird"
    ),
    "Minimum Opacity": "Kleinste Deckkraft",
    "Splats with a lower opacity are not loaded": "Splats mit geringerer Deckkraft werden nicht geladen",
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
    "Exact for the active camera, wrong from anywhere else": (
        "Exakt für die aktive Kamera, falsch von anderswo"
    ),
    "Ellipsoids": "Ellipsoide",
    "Instances that look right from everywhere": "Instanzen, die von überall richtig aussehen",
    "Points": "Punkte",
    "A point cloud: opaque and fast": "Eine Punktwolke: deckend und schnell",
    "Antialiased": "Mit Antialiasing",
    "For models that were trained with antialiasing. If it is not set here, the file decides": (
        "Für Modelle, die mit Antialiasing trainiert wurden. Ist es hier nicht eingestellt, entscheidet die Datei"
    ),
    "Prepare Viewports": "Ansichtsfenster vorbereiten",
    "Switch solid shading to material preview, and hide the outlines of selected objects, because both hide splats": (
        "Die Schattierung „Massiv“ auf „Materialbeispiel“ umstellen und die „Auswahlumrandung“ ausblenden, weil "
        "beides Splats verdeckt"
    ),
    # Cameras
    "Import the cameras of a data set (COLMAP, transforms.json) or of a run folder": (
        "Die Kameras eines Datensatzes (COLMAP, transforms.json) oder eines Trainingsordners importieren"
    ),
    "Follow the Model": "Dem Modell folgen",
    "Place the cameras like the active model, and ignore the up axis and scale below": (
        "Die Kameras so platzieren wie das aktive Modell, ohne Oben-Achse und Skalierung darunter zu beachten"
    ),
    "Downscale": "Verkleinern",
    "Divide the size of the photographs by this. 0: as in the training of the run, else 1": (
        "Die Größe der Fotografien hierdurch teilen. 0: wie beim Training, sonst 1"
    ),
    "Background Images": "Hintergrundbilder",
    "Show each photograph behind its camera": "Jede Fotografie hinter ihrer Kamera anzeigen",
    "Look Through the First": "Durch die erste schauen",
    "Make the first camera active, and render in the resolution of its photograph": (
        "Die erste Kamera zur aktiven machen und in der Auflösung ihrer Fotografie rendern"
    ),
    "Make the selected camera active, with the resolution and pixel aspect of its photograph": (
        "Die ausgewählte Kamera zur aktiven machen, mit Auflösung und Pixelseitenverhältnis ihrer Fotografie"
    ),
    "Import the key frames of dogsplat film as an animated camera": (
        "Die Schlüsselbilder von dogsplat film als animierte Kamera importieren"
    ),
    "Set the first and last frame of the scene to those of the path": (
        "Das erste und letzte Einzelbild der Szene auf die des Pfads setzen"
    ),
    "Export the scene's camera, frame by frame, in the coordinates of the model: for dogsplat film --path": (
        "Die Kamera der Szene Bild für Bild in den Koordinaten des Modells exportieren: für dogsplat film --path"
    ),
    "Step": "Schritt",
    "Frames from one key to the next": "Einzelbilder von einem Schlüsselbild zum nächsten",
    # Export
    "Export the selected splats as one PLY with their DoG data. Splats that nobody changed keep their bits": (
        "Die ausgewählten Splats als ein PLY mit ihren DoG-Daten exportieren. Splats, die nicht geändert wurden, "
        "behalten die Bits ihrer Datei"
    ),
    "Coordinates": "Koordinaten",
    "Of the File": "Der Datei",
    "Undo the up axis and scale of the import, but keep later movements": (
        "Oben-Achse und Skalierung des Imports rückgängig machen, aber spätere Bewegungen behalten"
    ),
    "Of the Scene": "Der Szene",
    "As the splats stand in Blender, z up": "Wie die Splats in Blender stehen, z nach oben",
    "Hidden Splats": "Verborgene Splats",
    "Ignore crop, limits and painting. If off, only what they show is written": (
        "Zuschnitt, Grenzen und Bemalung nicht beachten. Wenn aus, wird nur geschrieben, was diese zeigen"
    ),
    # Editing
    "Edit Splats": "Splats bearbeiten",
    "Show only the splats inside a new object, which you can move and animate; nothing is deleted. Mesh takes another "
    "selected mesh, and makes it a wire frame that renders do not show": (
        "Nur die Splats in einem neuen Objekt zeigen, das bewegt und animiert werden kann; nichts wird gelöscht. Mesh "
        "nimmt ein anderes ausgewähltes Mesh und macht es zu einem Drahtgitter, das beim Rendern nicht erscheint"
    ),
    "Shape": "Form",
    "Object": "Objekt",
    "Invert": "Invertieren",
    "Show what is outside instead": "Stattdessen zeigen, was außerhalb ist",
    "Limit the opacity, size and number of the splats that are shown; nothing is deleted": (
        "Deckkraft, Größe und Anzahl der Splats begrenzen, die gezeigt werden; nichts wird gelöscht"
    ),
    "Minimum Size": "Kleinste Größe",
    "Maximum Size": "Höchste Größe",
    "Count By": "Zählen nach",
    "Paint the splats with Blender's brushes, on a stand-in that has faces: weights erase, colors tint": (
        "Die Splats mit Blenders Pinseln bemalen, auf einem Stellvertreter mit Flächen: Gewichte radieren, Farben tönen"
    ),
    "What": "Was",
    "Erase": "Radieren",
    "Weight paint: splats with a weight above the threshold are hidden": (
        "Gewichtsmalerei: Splats mit einem Gewicht über dem Schwellwert werden verborgen"
    ),
    "Tint": "Tönung",
    "Vertex paint: colors are multiplied by the painted color": (
        "Vertexmalerei: Farben werden mit der gemalten Farbe multipliziert"
    ),
    "Threshold": "Schwellwert",
    "Store the painting with the splats, and remove the stand-in. You can continue painting later": (
        "Die Bemalung bei den Splats speichern und den Stellvertreter entfernen. Später kann weitergemalt werden"
    ),
    "Delete the splats that crop, limits and painting hide, and make tints part of the colors": (
        "Die Splats löschen, die Zuschnitt, Grenzen und Bemalung verbergen, und Tönungen in die Farben übernehmen"
    ),
    "Join the selected models into the active one, with their edits applied. Missing SH bands become zero": (
        "Die ausgewählten Modelle mit dem aktiven zusammenführen, mit angewandten Bearbeitungen. Fehlende SH-Bänder "
        "werden null"
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
    "Simplify the mesh to at most this many triangles; 0 keeps all of them": (
        "Das Mesh auf höchstens so viele Dreiecke vereinfachen; 0 behält alle"
    ),
    "Texture Size": "Texturgröße",
    "Store colors in a square picture with this many pixels along its side; 0: one color for each vertex": (
        "Farben in einem quadratischen Bild von so vielen Pixeln Seitenlänge speichern; 0: eine Farbe je Vertex"
    ),
    "Largest Part Only": "Nur der größte Teil",
    "Leave out everything that is not connected to the largest part": (
        "Alles weglassen, was nicht mit dem größten Teil zusammenhängt"
    ),
    "For a Room": "Für einen Raum",
    "Look at the splats only from inside, not from around them": (
        "Die Splats nur von innen betrachten, nicht von außen herum"
    ),
    "Rigid Body": "Starrkörper",
    "Make the mesh a passive rigid body, with which others collide": (
        "Das Mesh zu einem passiven Starrkörper machen, mit dem andere zusammenstoßen"
    ),
    "Cancel the surface mesh that is being made": "Das Oberflächen-Mesh abbrechen, das gerade entsteht",
    # Rendering
    "Set view transform, sampling and filter of this scene, and the colors of its models, for the exact picture": (
        "Ansichtstransformation, Abtastung und Filter dieser Szene und die Farben ihrer Modelle für das exakte Bild "
        "setzen"
    ),
    "Samples": "Abtastwerte",
    "1 samples the pixel centers, as splatting does. More samples smooth the edges of other objects": (
        "1 tastet die Pixelmitten ab, wie beim Splatting. Mehr glätten die Kanten anderer Objekte"
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
    "Remove the noise of a whole scene when all samples are done; splats in front stay sharp": (
        "Das Rauschen einer ganzen Szene entfernen, wenn alle Samples fertig sind; Splats im Vordergrund bleiben scharf"
    ),
    "Bounces": "Reflexionen",
    "How often light bounces in a whole scene": "Wie oft Licht in einer ganzen Szene reflektiert wird",
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
    "Points if the processor draws, else the most important splats": (
        "Punkte, wenn der Prozessor zeichnet, sonst die wichtigsten Splats"
    ),
    "The most important splats as points, in coarse pixels: for computers without a graphics card": (
        "Die wichtigsten Splats als Punkte, in groben Pixeln: für Rechner ohne Grafikkarte"
    ),
    "Most Important": "Wichtigste",
    "The most important splats, as they are shown": "Die wichtigsten Splats, wie sie angezeigt werden",
    "All": "Alle",
    "All splats": "Alle Splats",
    "Splats While Moving": "Splats beim Bewegen",
    "How many splats a moving viewport shows: the most important ones": (
        "Wie viele Splats ein bewegtes Ansichtsfenster zeigt: die wichtigsten"
    ),
    "Follow View": "Ansicht folgen",
    "Compute colors, and the quads of Automatic, for the viewport that moved last instead of the camera. Renders "
    "still use the camera": (
        "Farben, und die Vierecke von „Automatisch“, für das zuletzt bewegte Ansichtsfenster statt für die Kamera "
        "berechnen. Gerendert wird weiterhin für die Kamera"
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
    "Let Blender draw the selected splats itself, as plain Gaussians. What crop, limits and painting hide is gone": (
        "Blender die ausgewählten Splats selbst zeichnen lassen, als einfache Gauß-Splats. Was Zuschnitt, Grenzen und "
        "Malen verbergen, wird gelöscht"
    ),
    "Let the add-on draw the selected native splats: exactly, with their DoG, and with all edits made since": (
        "Das Add-on die ausgewählten Splats zeichnen lassen: exakt, mit ihren DoG und mit allem, was seither "
        "bearbeitet wurde"
    ),
    "Keep Original": "Original behalten",
    "Keep the object that is converted in the file, hidden": (
        "Das Objekt, das umgewandelt wird, verborgen in der Datei lassen"
    ),
    "{name}: plain Gaussians, by Blender": "{name}: einfache Gauß-Splats, von Blender",
    # Preferences
    "Command dogsplat": "Befehl dogsplat",
    "Path of the command dogsplat of the package mi_dogsplat, or words such as python -m mi_dogsplat. If empty: the "
    "package in Blender's Python, else the command on the PATH": (
        "Pfad des Befehls dogsplat des Pakets mi_dogsplat, oder Wörter wie python -m mi_dogsplat. Wenn leer: das "
        "Paket in Blenders Python, sonst der Befehl im PATH"
    ),
    "Splats Follow Their Points": "Splats folgen ihren Punkten",
    "Rotate and scale splats when Apply Transform, Join or edit mode moves their points": (
        "Splats drehen und skalieren, wenn „Transformation anwenden“, „Zusammenführen“ oder der Bearbeitungsmodus "
        "ihre Punkte bewegt"
    ),
}
