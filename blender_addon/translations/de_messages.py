"""German reports and errors; what stands in braces is put in."""

MESSAGES = {
    # What was done
    "{total:,} splats imported, {dog:,} of them DoG": "{total:,} Splats importiert, davon {dog:,} DoG",
    "{n:,} with slopes": "{n:,} mit Farbverläufen",
    "{n:,} with curvatures": "{n:,} mit Krümmungen",
    "{n:,} with a cut": "{n:,} mit einem Schnitt",
    "{n:,} with a second cut": "{n:,} mit einem zweiten Schnitt",
    "{n:,} with shifts": "{n:,} mit Verschiebungen",
    "{count:,} splats exported": "{count:,} Splats exportiert",
    "{count:,} splats deleted": "{count:,} Splats gelöscht",
    "{count:,} triangles": "{count:,} Dreiecke",
    "{count} cameras imported": "{count} Kameras importiert",
    "{count} cameras imported, {bent} without lens distortion: their photographs fit only in the middle": (
        "{count} Kameras importiert, {bent} ohne Linsenverzeichnung: ihre Fotos passen nur in der Mitte"
    ),
    "{count} key frames imported": "{count} Schlüsselbilder importiert",
    "{count} key frames exported": "{count} Schlüsselbilder exportiert",
    "set up, but models of linked files keep their colors: {names}; make library overrides of them": (
        "eingerichtet, aber Modelle verknüpfter Dateien behalten ihre Farben: {names}; Bibliotheksüberschreibungen "
        "davon erstellen"
    ),
    "View transform Raw, pixel filter of one pixel, exact colors": (
        "Ansichtstransformation Raw, Pixelfilter von einem Pixel, exakte Farben"
    ),
    "sending the scene": "Szene wird gesendet",
    "{count:,} splats, {name}": "{count:,} Splats, {name}",
    # Surface meshes
    '"{name}": it shows no splats; open its crop and its limits': (
        "„{name}“: es zeigt keine Splats; Zuschnitt und Grenzen öffnen"
    ),
    '"{name}": its splats were moved or deleted before their surface was there; make it again': (
        "„{name}“: seine Splats wurden bewegt oder gelöscht, bevor ihre Oberfläche da war; sie neu erzeugen"
    ),
    "a texture is for few triangles; set Most Triangles as well, to 20000 for instance": (
        "Eine Textur ist für wenige Dreiecke; auch „Höchstens Dreiecke“ setzen, zum Beispiel auf 20000"
    ),
    "dogsplat mesh has written what the add-on cannot read; update both": (
        "dogsplat mesh hat geschrieben, was das Add-on nicht lesen kann; beide aktualisieren"
    ),
    # Files
    "this is a folder": "das ist ein Ordner",
    "give the path of a model": "den Pfad eines Modells angeben",
    "give the path of a PLY file": "den Pfad einer PLY-Datei angeben",
    "no such file or folder": "keine solche Datei und kein solcher Ordner",
    "check the path": "den Pfad prüfen",
    "cannot be read ({reason})": "kann nicht gelesen werden ({reason})",
    "check the path and its permissions": "den Pfad und seine Rechte prüfen",
    "cannot be written ({reason})": "kann nicht geschrieben werden ({reason})",
    "cannot be removed ({reason})": "kann nicht entfernt werden ({reason})",
    "close what has it open, and check that its folder is writable": (
        "schließen, was sie geöffnet hat, und prüfen, ob ihr Ordner beschreibbar ist"
    ),
    "check that the folder exists, is writable and has space": (
        "prüfen, ob der Ordner existiert, beschreibbar ist und Platz hat"
    ),
    "copy or export the file again": "die Datei neu kopieren oder exportieren",
    # PLY
    'not a PLY file (its first line is not "ply")': "keine PLY-Datei (ihre erste Zeile ist nicht „ply“)",
    'the header has no "format" line': "im Kopf fehlt die Zeile „format“",
    'the header has no "end_header" line': "im Kopf fehlt die Zeile „end_header“",
    'header line "{line}" makes no sense': "die Kopfzeile „{line}“ ergibt keinen Sinn",
    'element "{name}" is declared twice': "Element „{name}“ ist zweimal angegeben",
    'property "{name}" is declared twice': "Eigenschaft „{name}“ ist zweimal angegeben",
    'there is no element "vertex"': "es gibt kein Element „vertex“",
    'element "{element}" has no property "{name}"': "Element „{element}“ hat keine Eigenschaft „{name}“",
    "give a 3D Gaussian splatting PLY with the columns x y z f_dc_* opacity scale_* rot_*": (
        "ein PLY für 3D Gaussian Splatting mit den Spalten x y z f_dc_* opacity scale_* rot_* angeben"
    ),
    "this is a compressed PLY, export it uncompressed": ("das ist ein komprimiertes PLY, es unkomprimiert exportieren"),
    "{n} properties f_rest_*, but SH degree 0, 1, 2, 3 has 0, 9, 24, 45": (
        "{n} Eigenschaften f_rest_*, aber SH-Grad 0, 1, 2, 3 hat 0, 9, 24, 45"
    ),
    'view-dependent color both in the element "vertex" and in the element "{name}"': (
        "blickabhängige Farbe sowohl im Element „vertex“ als auch im Element „{name}“"
    ),
    "keep f_rest_* in one of the two": "f_rest_* in einem von beiden behalten",
    'DoG data both in the element "vertex" and in the element "dog"': (
        "DoG-Daten sowohl im Element „vertex“ als auch im Element „dog“"
    ),
    "keep one of the two": "eines von beiden behalten",
    "more than one of the elements sh1, sh2, sh3 names primitive {number}": (
        "mehr als eines der Elemente sh1, sh2, sh3 nennt Primitiv {number}"
    ),
    "data is left over after the last element": "nach dem letzten Element bleiben Daten übrig",
    'the element "{name}" does not name different primitives of 0 to {last}': (
        "das Element „{name}“ nennt nicht lauter verschiedene Primitive von 0 bis {last}"
    ),
    'element "{name}" has a list property': "das Element „{name}“ hat eine Listeneigenschaft",
    'element "{name}" holds something that is not a number': "das Element „{name}“ enthält etwas, das keine Zahl ist",
    'the file ends inside of element "{name}"': "die Datei endet mitten im Element „{name}“",
    '"{name}" in row {row} of the element "{element}" is not finite': (
        "„{name}“ in Zeile {row} des Elements „{element}“ ist nicht endlich"
    ),
    "the model holds values that are not finite": "das Modell enthält Werte, die nicht endlich sind",
    "delete those splats; nothing was written": "diese Splats löschen; nichts wurde geschrieben",
    # SPZ and other formats
    "is not an SPZ file: its header does not begin with NGSP": "ist keine SPZ-Datei: ihr Kopf beginnt nicht mit NGSP",
    "not SPZ of version 1, 2 or 3, but {version}": "nicht SPZ der Version 1, 2 oder 3, sondern {version}",
    "convert it to PLY": "sie in PLY umwandeln",
    "has spherical harmonics of degree {degree}, there are 0 to 4": ("hat SH-Grad {degree}, es gibt 0 bis 4"),
    "a position is not finite": "eine Position ist nicht endlich",
    "{size} bytes cannot hold {n} splats": "{size} Bytes können keine {n} Splats enthalten",
    "{n} splats need {need} bytes, the file has {size}": "{n} Splats brauchen {need} Bytes, die Datei hat {size}",
    "its gzip stream ends before its check sum": "sein gzip-Strom endet vor seiner Prüfsumme",
    "no gzip stream of an SPZ file ({reason})": "kein gzip-Strom einer SPZ-Datei ({reason})",
    "only the package reads this format, and {reason}": "nur das Paket liest dieses Format, und: {reason}",
    "install the package mi_dogsplat[export] and name its command in the preferences, or convert it to PLY": (
        "das Paket mi_dogsplat[export] installieren und seinen Befehl in den Einstellungen nennen, oder in PLY "
        "umwandeln"
    ),
    # Models and objects
    '"{name}": {reason}': "„{name}“: {reason}",
    '"{name}": {n:,} of its splats have values that are not finite; delete them': (
        "„{name}“: {n:,} seiner Splats haben Werte, die nicht endlich sind; sie löschen"
    ),
    "no splat is left": "kein Splat bleibt übrig",
    "lower the minimum opacity, or check that the model has any": (
        "die kleinste Deckkraft senken, oder prüfen, ob das Modell Splats hat"
    ),
    '"{name}": no splat is left; open its crop or its limits': (
        "„{name}“: kein Splat bleibt übrig; Zuschnitt oder Grenzen weiter öffnen"
    ),
    "splats cannot be flattened, but this object is scaled to nothing along an axis": (
        "Splats können nicht flach sein, aber dieses Objekt ist entlang einer Achse auf null skaliert"
    ),
    '"{name}": the number of its points has changed, so its painting does not fit any more; undo that, or delete it '
    "and its modifier": (
        "„{name}“: die Anzahl seiner Punkte hat sich geändert, sodass die Bemalung nicht mehr passt; das rückgängig "
        "machen, oder es und seinen Modifikator löschen"
    ),
    '"{name}": its constraints would move it once more; apply or mute them first': (
        "„{name}“: seine Constraints würden es noch einmal bewegen; sie zuerst anwenden oder stummschalten"
    ),
    '"{name}": keys or drivers of its transform would move it once more; delete or mute them first': (
        "„{name}“: Schlüsselbilder oder Treiber seiner Transformation würden es noch einmal bewegen; sie zuerst "
        "löschen oder stummschalten"
    ),
    '"{name}": its shape keys would take its splats back; apply all of them first': (
        "„{name}“: seine Formschlüssel würden seine Splats zurückholen; zuerst alle anwenden"
    ),
    "some of these models hold radiance, others sRGB values; join those of one kind": (
        "manche dieser Modelle enthalten Strahldichte, andere sRGB-Werte; solche von einer Art zusammenführen"
    ),
    "only the package bakes DoG into plain Gaussians, and {reason}": (
        "nur das Paket rechnet DoG in einfache Gauß-Splats ein, und: {reason}"
    ),
    'the mesh "{mesh}" has no usable attribute "{name}"; import the model again': (
        "das Mesh „{mesh}“ hat kein brauchbares Attribut „{name}“; das Modell neu importieren"
    ),
    'attribute "{name}" of "{mesh}" is {kind}; import the model again': (
        "das Attribut „{name}“ von „{mesh}“ ist {kind}; das Modell neu importieren"
    ),
    "the selected splats are hidden in this view layer; show them first": (
        "die ausgewählten Splats sind in dieser Ansichtsebene verborgen; sie zuerst anzeigen"
    ),
    "what is selected shows no splats; select some, or what makes instances of them": (
        "was ausgewählt ist, zeigt keine Splats; welche auswählen, oder was Instanzen von ihnen macht"
    ),
    'the custom property {name} of "{object}" is no matrix with an inverse; remove it, or import again': (
        "die benutzerdefinierte Eigenschaft {name} von „{object}“ ist keine Matrix mit einer Inversen; sie entfernen "
        "oder neu importieren"
    ),
    "there is no splat to export": "es gibt keinen Splat zu exportieren",
    "select a model that has some, or open its crop": (
        "ein Modell auswählen, das welche hat, oder seinen Zuschnitt weiter öffnen"
    ),
    # Cameras
    "give a folder with sparse/0, transforms.json or transforms_train.json, such a file, or a run folder": (
        "einen Ordner mit sparse/0, transforms.json oder transforms_train.json, eine solche Datei oder einen "
        "Trainingsordner angeben"
    ),
    "no cameras found": "keine Kameras gefunden",
    'has no cameras ("frames" is absent or empty)': "hat keine Kameras („frames“ fehlt oder ist leer)",
    "does not name a data set": "nennt keinen Datensatz",
    'its data set "{data}" is not there': "der Datensatz „{data}“ ist nicht da",
    'its "downscale" is not a whole number above 0': "„downscale“ darin ist keine ganze Zahl über 0",
    "import the cameras from the data set itself": "die Kameras aus dem Datensatz selbst importieren",
    "not valid JSON in line {line} ({reason})": "kein gültiges JSON in Zeile {line} ({reason})",
    "correct that line": "diese Zeile berichtigen",
    "give a text file in UTF-8": "eine Textdatei in UTF-8 angeben",
    "is not a JSON object": "ist kein JSON-Objekt",
    'frame {number} lacks "file_path" or "transform_matrix"': (
        "in Bild {number} fehlt „file_path“ oder „transform_matrix“"
    ),
    "add both to each frame": "beides in jedem Bild ergänzen",
    "frame {number}: {reason}": "Bild {number}: {reason}",
    "correct its numbers": "dessen Zahlen berichtigen",
    'the pose of "{name}" cannot be used ({reason})': "die Pose von „{name}“ ist nicht brauchbar ({reason})",
    "its shape is not 4 x 4, or it is not finite": "sie ist nicht 4 x 4 groß oder nicht endlich",
    "it is not a rotation and a translation": "sie ist keine Drehung mit Verschiebung",
    "correct it": "sie berichtigen",
    '"{name}" has the lens {lens}, which is none of {known}': "„{name}“ hat die Linse {lens}, keine von {known}",
    "undistort the images first": "zuerst die Bilder entzerren",
    "cx {cx:g} and cy {cy:g} of an image of {size} are shares of its sides, not pixels": (
        "cx {cx:g} und cy {cy:g} eines Bildes von {size} sind Anteile seiner Seiten, keine Pixel"
    ),
    '"{name}" has no focal length or no size': "„{name}“ hat keine Brennweite oder keine Größe",
    'add "fl_x", "fl_y", "w", "h" in pixels': "„fl_x“, „fl_y“, „w“, „h“ in Pixeln ergänzen",
    "cannot be read as an image": "kann nicht als Bild gelesen werden",
    'add "w" and "h" to the frames': "bei den Bildern „w“ und „h“ ergänzen",
    'the camera "{name}" has the type {kind}; splats need a perspective or orthographic camera': (
        "die Kamera „{name}“ hat den Typ „{kind}“; Splats brauchen eine perspektivische oder orthografische Kamera"
    ),
    'the camera "{name}" is mirrored; make its scale, and those of its parents, positive': (
        "die Kamera „{name}“ ist gespiegelt; ihre Skalierung und die ihrer Eltern positiv machen"
    ),
    'the camera "{name}" is sheared by its parents; apply their scale': (
        "die Kamera „{name}“ wird durch ihre Eltern geschert; deren Skalierung anwenden"
    ),
    'the camera "{name}" is orthographic; this needs a perspective camera': (
        "die Kamera „{name}“ ist orthografisch; dazu braucht es eine perspektivische Kamera"
    ),
    # COLMAP
    "the model has no registered image": "das Modell hat kein registriertes Bild",
    "run COLMAP's mapper until images register": "COLMAPs Mapper ausführen, bis Bilder registriert sind",
    'image "{name}" uses camera {number}, which is not there': (
        "das Bild „{name}“ verwendet die Kamera {number}, die nicht da ist"
    ),
    "copy the file again or export the model again": "die Datei neu kopieren oder das Modell neu exportieren",
    "camera {number} has the model {model}, which is none of {known}": (
        "die Kamera {number} hat das Modell {model}, keines von {known}"
    ),
    "run COLMAP's image_undistorter and use the folder that it writes": (
        "COLMAPs image_undistorter ausführen und den Ordner verwenden, den er schreibt"
    ),
    "camera {number} is {size} with parameters {values}": "die Kamera {number} ist {size} mit Parametern {values}",
    "camera {number} has {count} parameters": "die Kamera {number} hat {count} Parameter",
    "camera {number}: {reason}": "die Kamera {number}: {reason}",
    "multiply them by width and height": "sie mit Breite und Höhe multiplizieren",
    "{size} bytes instead of {expected}": "{size} Bytes statt {expected}",
    # Camera paths
    "cannot be read as JSON ({reason})": "kann nicht als JSON gelesen werden ({reason})",
    "has no list of keys": "hat keine Liste von Schlüsselbildern",
    'give {"keys": [{"time": seconds, "position": [x, y, z], "look_at": [x, y, z], "fov": degrees}, ...]}': (
        '{"keys": [{"time": Sekunden, "position": [x, y, z], "look_at": [x, y, z], "fov": Grad}, ...]} angeben'
    ),
    "key {number} cannot be used ({reason})": "das Schlüsselbild {number} ist nicht brauchbar ({reason})",
    "its keys are not in order of time": "die Schlüsselbilder sind nicht nach der Zeit geordnet",
    "sort them": "sie sortieren",
    'key {number} lacks "time"': "dem Schlüsselbild {number} fehlt „time“",
    "give each key its time, or none": "jedem Schlüsselbild seine Zeit geben oder keinem",
    '"time" is not finite': "„time“ ist nicht endlich",
    "its lengths in pixels fit no camera": "seine Längen in Pixeln passen zu keiner Kamera",
    '"fov" is {fov:g}, not within 0 to 180 degrees': "„fov“ ist {fov:g}, nicht zwischen 0 und 180 Grad",
    '"{name}" is not {count} numbers': "„{name}“ besteht nicht aus {count} Zahlen",
    '"look_at" is at the position itself, or straight above or below it': (
        "„look_at“ liegt in der Position selbst oder genau darüber oder darunter"
    ),
    '"rotation" is not a unit quaternion x, y, z, w': "„rotation“ ist kein Einheitsquaternion x, y, z, w",
    "the model is mirrored, sheared or scaled unevenly: no camera sees that; apply its transform": (
        "das Modell ist gespiegelt, geschert oder ungleichmäßig skaliert: das sieht keine Kamera; seine Transformation "
        "anwenden"
    ),
    # Training
    "{n} cameras, {n_test} of them for testing": "{n} Kameras, davon {n_test} zum Prüfen",
    "{n} views rendered": "{n} Ansichten gerendert",
    "{done} of {n} views; Esc stops, and what is rendered is kept": (
        "{done} von {n} Ansichten; Esc hält an, und was gerendert ist, bleibt"
    ),
    "stopped after {done} of {n} views; Go On Rendering does the rest": (
        "angehalten nach {done} von {n} Ansichten; „Weiter rendern“ erledigt den Rest"
    ),
    "trained, imported from {folder}": "trainiert, importiert aus {folder}",
    'trained, but no window shows "{scene}"; import {model}': (
        "trainiert, aber kein Fenster zeigt „{scene}“; {model} importieren"
    ),
    "the training ended with status {status}; see {log}": "das Training endete mit Status {status}; siehe {log}",
    "save the file, or choose a folder": "die Datei speichern oder einen Ordner wählen",
    "is a folder with other contents": "ist ein Ordner mit anderem Inhalt",
    "the objects that the cameras were made for are deleted; select others, make new cameras": (
        "die Objekte, für die die Kameras erzeugt wurden, sind gelöscht; andere auswählen, neue Kameras erzeugen"
    ),
    'belongs to the scene "{scene}" of {file}': "gehört zur Szene „{scene}“ von {file}",
    "choose another folder for the training": "einen anderen Ordner für das Training wählen",
    "was not rendered": "wurde nicht gerendert",
    "look for the reason in Blender's console": "den Grund in Blenders Konsole suchen",
    "two cameras of the rig would both write {name}; rename one of them": (
        "zwei Kameras der Anordnung würden beide {name} schreiben; eine davon umbenennen"
    ),
    '"{name}" is in no collection that this view layer renders; show one, or make new cameras': (
        "„{name}“ ist in keiner Sammlung, die diese Ansichtsebene rendert; eine anzeigen oder neue Kameras machen"
    ),
    "there is room for {found} of {n} cameras inside; use fewer, or mark an emptier region": (
        "innen ist Platz für {found} von {n} Kameras; weniger verwenden oder einen leereren Bereich markieren"
    ),
    "the lowest elevation is above the highest; exchange them": (
        "der niedrigste Höhenwinkel liegt über dem höchsten; sie vertauschen"
    ),
    "no region is chosen; choose an empty or another object that marks it": (
        "kein Bereich ist gewählt; ein Leer-Objekt oder ein anderes Objekt wählen, das ihn markiert"
    ),
    "the subject has no surfaces; select objects with faces, or mark a region": (
        "das Motiv hat keine Flächen; Objekte mit Flächen auswählen oder einen Bereich markieren"
    ),
    "nothing is selected; select the objects to train, or choose Whole Scene": (
        "nichts ist ausgewählt; die Objekte zum Trainieren auswählen oder „Ganze Szene“ wählen"
    ),
    # Rendering
    '"{name}": its colors are wrong since the working space {space} was chosen; import the model again': (
        "„{name}“: seine Farben sind falsch, seit der Arbeitsfarbraum {space} gewählt wurde; das Modell neu importieren"
    ),
    "some models hold sRGB values, others radiance; the sRGB values are converted to radiance": (
        "manche Modelle enthalten sRGB-Werte, andere Strahldichte; die sRGB-Werte werden in Strahldichte umgerechnet"
    ),
    "the scene has no camera; add one, or import those of the data set": (
        "die Szene hat keine Kamera; eine hinzufügen oder die des Datensatzes importieren"
    ),
    "the scene has no splats to render; import a model with File > Import > DoG Splat": (
        "die Szene hat keine Splats zum Rendern; ein Modell importieren mit Datei > Importieren > DoG-Splat"
    ),
    "Mitsuba is not there: install the package with \"pip install '.[train,export,mesh]'\" in the folder of its "
    "repository, in any Python, and name its command dogsplat in the preferences of this add-on": (
        "Mitsuba ist nicht da: das Paket mit „pip install '.[train,export,mesh]'“ im Ordner seines Repositorys, in "
        "einem beliebigen Python, installieren und seinen Befehl dogsplat in den Einstellungen dieses Add-ons nennen"
    ),
    "Mitsuba cannot be used here ({reason})": "Mitsuba ist hier nicht brauchbar ({reason})",
    "mi_dogsplat cannot be used here ({reason})": "mi_dogsplat ist hier nicht brauchbar ({reason})",
    '"{command}", the command in the preferences of DoG Splat, is not there; correct or clear it': (
        "„{command}“, der Befehl in den Einstellungen von DoG Splat, ist nicht da; ihn berichtigen oder leeren"
    ),
    "{name} cannot be started ({reason})": "{name} kann nicht gestartet werden ({reason})",
    "{name}: no answer": "{name}: keine Antwort",
    "{name}: does not answer as dogsplat serve does; update the package": (
        "{name}: antwortet nicht wie dogsplat serve; das Paket aktualisieren"
    ),
    "Mitsuba in this process": "Mitsuba in diesem Prozess",
    "exit status {status}": "Exit-Status {status}",
}
