"""German labels and tooltips of the panel "Train Splats"; labels of its operators are with all others."""

# What Blender would say otherwise: it has other words for some of these
OWN = {
    "Subject": "Motiv",
    "Selected Objects": "Ausgewählte Objekte",
    "Whole Scene": "Ganze Szene",
    "Region": "Bereich",
    "Cameras": "Kameras",
    "Around": "Rundherum",
    "Inside": "Innen",
    "Preset": "Vorgabe",
    "Ours": "Unsere",
    "Ours with Slopes": "Unsere mit Verläufen",
    "Ours with Slopes and Cuts": "Unsere mit Verläufen und Schnitten",
    "Ours, Preconditioned": "Unsere, vorkonditioniert",
    "Ours with Second Cuts": "Unsere mit zweiten Schnitten",
    "Ours with Curvatures": "Unsere mit Krümmungen",
    "Ours with Shifts": "Unsere mit Verschiebungen",
    "Ours, Early": "Unsere, früh",
    "Paper": "Veröffentlichung",
    "Released": "Veröffentlichter Code",
    "3DGS": "3DGS",
}

REST = {
    "Train Splats": "Splats trainieren",
    "What is selected when the cameras are made": "Was ausgewählt ist, wenn die Kameras erzeugt werden",
    "All that renders show": "Alles, was beim Rendern erscheint",
    "Region": "Bereich",
    "What is in the box of an object, such as an empty; nothing is hidden": (
        "Was im Quader eines Objekts liegt, etwa eines Leer-Objekts; nichts wird verborgen"
    ),
    "An empty, whose cube counts, or any object with a size": (
        "Ein Leer-Objekt, dessen Würfel zählt, oder ein beliebiges Objekt mit einer Größe"
    ),
    "On a sphere, all looking at its middle, as dogsplat capture has them": (
        "Auf einer Kugel, alle zur Mitte gerichtet, wie bei dogsplat capture"
    ),
    "Spread over the room, looking into all directions: for interiors": (
        "Im Raum verteilt, in alle Richtungen gerichtet: für Innenräume"
    ),
    "Views": "Ansichten",
    "Training views; a sixth as many more measure how good the model is": (
        "Ansichten für das Training; ein Sechstel mehr misst, wie gut das Modell ist"
    ),
    "Elevations": "Höhenwinkel",
    "Lowest and highest, in degrees: 0 to 90 is a dome, -90 to 90 a sphere": (
        "Niedrigster und höchster, in Grad: 0 bis 90 ist eine Kuppel, -90 bis 90 eine Kugel"
    ),
    "Zoom": "Zoom",
    "At 1 the subject's sphere just fits, at 2 it is twice as large": (
        "Bei 1 passt die Kugel des Motivs gerade ins Bild, bei 2 ist sie doppelt so groß"
    ),
    "Size": "Größe",
    "Of the pictures, in pixels": "Der Bilder, in Pixeln",
    "Subject Alone": "Nur das Motiv",
    "Cameras do not see other objects; their shadows and light stay": (
        "Kameras sehen keine anderen Objekte; deren Schatten und Licht bleiben"
    ),
    "Transparent": "Transparent",
    "Nothing behind the subject: the model ends where it ends. Off: the world is trained too": (
        "Nichts hinter dem Motiv: das Modell endet, wo es endet. Aus: die Welt wird mittrainiert"
    ),
    "Linear (HDR)": "Linear (HDR)",
    "OpenEXR of linear radiance instead of PNG: highlights do not end at white": (
        "OpenEXR mit linearer Strahldichte statt PNG: Glanzlichter enden nicht bei Weiß"
    ),
    "Folder": "Ordner",
    "For the data set, in data, and the training, in run. Names of file and scene take their places": (
        "Für den Datensatz, in data, und das Training, in run. Die Namen von Datei und Szene treten an ihre Stellen"
    ),
    "Pruned and made DoG: the recipe of this package": "Ausgedünnt und zu DoG gemacht: das Rezept dieses Pakets",
    "Ours, with colors that vary over their splats": "Unser Rezept, mit Farben, die über ihre Splats verlaufen",
    "Ours, with such colors, and with splats that planes cut off": (
        "Unser Rezept, mit solchen Farben und mit Splats, die von Ebenen abgeschnitten werden"
    ),
    "With slopes, cuts, and steps that move a splat's numbers jointly": (
        "Mit Farbverläufen und Schnitten, und mit Schritten, die die Zahlen eines Splats gemeinsam bewegen"
    ),
    "As preconditioned, and a second plane may cut off each splat": (
        "Wie vorkonditioniert, und eine zweite Ebene kann jeden Splat abschneiden"
    ),
    "As with second cuts, and a brightness that curves over each splat": (
        "Wie mit zweiten Schnitten, und mit einer Helligkeit, die über jeden Splat gekrümmt verläuft"
    ),
    "As with shifts, and a shorter growth in larger steps: quicker": (
        "Wie mit Verschiebungen, und mit kürzerem Wachstum in größeren Schritten: schneller"
    ),
    "As with curvatures, and places of splats that depend on the view": (
        "Wie mit Krümmungen, und mit Orten von Splats, die von der Blickrichtung abhängen"
    ),
    "The published method, as it is printed": "Das veröffentlichte Verfahren, wie es gedruckt steht",
    "The published method, as in its code": "Das veröffentlichte Verfahren, wie in seinem veröffentlichten Code",
    "Plain 3D Gaussian splatting: nothing is pruned, nothing is DoG": (
        "Einfaches 3D Gaussian Splatting: nichts wird ausgedünnt, nichts ist DoG"
    ),
    "Steps": "Schritte",
    "The schedule scales along": "Der Zeitplan wird mitskaliert",
    "Target": "Ziel",
    "What pruning leaves: a share (10%), a count (20000), or a size (2MB)": (
        "Was das Ausdünnen übrig lässt: einen Anteil (10%), eine Anzahl (20000) oder eine Größe (2MB)"
    ),
    "At Most": "Höchstens",
    "Primitives at any time; 0: no limit, which takes long": (
        "Primitive zu jeder Zeit; 0: keine Grenze, was lange dauert"
    ),
    "Hide Originals": "Originale verbergen",
    "The model takes their place, in viewports and renders": (
        "Das Modell tritt an ihre Stelle, in Ansichtsfenstern und beim Rendern"
    ),
    "Make the cameras of the rig, which may be moved, deleted and added to before they render": (
        "Die Kameras der Anordnung erzeugen; vor dem Rendern können sie bewegt, gelöscht und ergänzt werden"
    ),
    "{n} cameras in the rig": "{n} Kameras in der Anordnung",
    "Render the views of the rig into the data set; Esc stops, and the next start goes on there": (
        "Die Ansichten der Anordnung in den Datensatz rendern; Esc hält an, und der nächste Start macht dort weiter"
    ),
    "Train": "Trainieren",
    "Then train on them, and import the model": "Danach damit trainieren und das Modell importieren",
    "Train a model on the rendered views, in a process of its own, and import it in place of the subject": (
        "Ein Modell mit den gerenderten Ansichten trainieren, in einem eigenen Prozess, und an Stelle des Motivs "
        "importieren"
    ),
    "Go On": "Weitermachen",
    "From the last checkpoint, with the same settings": "Vom letzten Sicherungspunkt, mit denselben Einstellungen",
    "Save a checkpoint and stop; Go On Training continues there": (
        "Einen Sicherungspunkt speichern und anhalten; „Weiter trainieren“ setzt dort fort"
    ),
    "{done} of {n} views": "{done} von {n} Ansichten",
    "Esc stops; what is rendered is kept": "Esc hält an; was gerendert ist, bleibt",
    "Training starts": "Training beginnt",
    "Stopping: a checkpoint is saved": "Hält an: ein Sicherungspunkt wird gespeichert",
    "Step {step:,} of {steps:,}": "Schritt {step:,} von {steps:,}",
    "Measuring": "Qualität wird gemessen",
}
