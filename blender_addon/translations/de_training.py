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
    "Everything that renders show": "Alles, was beim Rendern erscheint",
    "Region": "Bereich",
    "What is in the box of an object, such as an empty; nothing is hidden": (
        "Was im Quader eines Objekts liegt, etwa eines Leer-Objekts; nichts wird verborgen"
    ),
    "An empty, which marks its cube, or any object that has a size": (
        "Ein Leer-Objekt, das seinen Würfel markiert, oder ein beliebiges Objekt mit einer Größe"
    ),
    "On a sphere, all looking at its middle, as in dogsplat capture": (
        "Auf einer Kugel, alle zur Mitte gerichtet, wie bei dogsplat capture"
    ),
    "Spread over the room, looking into all directions: for interiors": (
        "Im Raum verteilt, in alle Richtungen gerichtet: für Innenräume"
    ),
    "Views": "Ansichten",
    "Number of training views. A sixth as many more are rendered to measure the model": (
        "Anzahl der Ansichten für das Training. Ein Sechstel mehr wird gerendert, um das Modell zu messen"
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
    "Width and height of the views, in pixels": "Breite und Höhe der Ansichten, in Pixeln",
    "Subject Alone": "Nur das Motiv",
    "Cameras do not see other objects; their shadows and light stay": (
        "Kameras sehen keine anderen Objekte; deren Schatten und Licht bleiben"
    ),
    "Transparent": "Transparent",
    "The views have a transparent background, so that the model has only the subject. If off, the world is trained, "
    "too": (
        "Die Ansichten haben einen transparenten Hintergrund, sodass das Modell nur das Motiv hat. Wenn aus, wird die "
        "Welt mittrainiert"
    ),
    "Linear (HDR)": "Linear (HDR)",
    "OpenEXR of linear radiance instead of PNG: highlights are not clipped at white": (
        "OpenEXR mit linearer Strahldichte statt PNG: Glanzlichter werden nicht bei Weiß abgeschnitten"
    ),
    "Folder": "Ordner",
    "Folder of the data set (data) and of the training (run). The names of file and scene are filled in": (
        "Ordner des Datensatzes (data) und des Trainings (run). Die Namen von Datei und Szene werden eingesetzt"
    ),
    "The recipe of this package: the model is pruned, and becomes DoG": (
        "Das Rezept dieses Pakets: das Modell wird ausgedünnt und zu DoG"
    ),
    "Ours, with colors that vary over their splats": "Unser Rezept, mit Farben, die über ihre Splats verlaufen",
    "Ours, with such colors, and with splats that planes cut off": (
        "Unser Rezept, mit solchen Farben und mit Splats, die von Ebenen abgeschnitten werden"
    ),
    "With slopes, cuts, and steps that move the numbers of a splat together": (
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
    "Training steps; the whole schedule is scaled to them": (
        "Schritte des Trainings; der ganze Zeitplan wird mitskaliert"
    ),
    "Target": "Ziel",
    "Size after pruning: a share (10%), a count of primitives (20000), or a size of the file (2MB)": (
        "Größe nach dem Ausdünnen: ein Anteil (10%), eine Anzahl von Primitiven (20000) oder eine Größe der Datei (2MB)"
    ),
    "At Most": "Höchstens",
    "Largest number of primitives during training; 0: no limit, which takes long": (
        "Höchste Anzahl von Primitiven im Training; 0: keine Grenze, was lange dauert"
    ),
    "Hide Originals": "Originale verbergen",
    "Hide the original objects in viewports and renders, because the model takes their place": (
        "Die Originale in Ansichtsfenstern und beim Rendern verbergen, weil das Modell an ihre Stelle tritt"
    ),
    "Make the cameras of the rig. You can move, delete and add cameras before rendering": (
        "Die Kameras der Anordnung erzeugen. Vor dem Rendern können Kameras bewegt, gelöscht und ergänzt werden"
    ),
    "{n} cameras in the rig": "{n} Kameras in der Anordnung",
    "Render the views of the rig into the data set. Esc stops, and the next start continues from there": (
        "Die Ansichten der Anordnung in den Datensatz rendern; Esc hält an, und der nächste Start macht dort weiter"
    ),
    "Train": "Trainieren",
    "Then train on them, and import the model": "Danach damit trainieren und das Modell importieren",
    "Train a model on the rendered views, in a process of its own, and import it in place of the subject": (
        "Ein Modell mit den gerenderten Ansichten trainieren, in einem eigenen Prozess, und an Stelle des Motivs "
        "importieren"
    ),
    "Go On": "Weitermachen",
    "Continue from the last checkpoint, with the same settings": (
        "Vom letzten Sicherungspunkt weitermachen, mit denselben Einstellungen"
    ),
    "Save a checkpoint and stop; Go On Training continues from there": (
        "Einen Sicherungspunkt speichern und anhalten; „Weiter trainieren“ setzt dort fort"
    ),
    "{done} of {n} views": "{done} von {n} Ansichten",
    "Esc stops; what is rendered is kept": "Esc hält an; was gerendert ist, bleibt",
    "Training starts": "Training beginnt",
    "Stopping: a checkpoint is saved": "Hält an: ein Sicherungspunkt wird gespeichert",
    "Step {step:,} of {steps:,}": "Schritt {step:,} von {steps:,}",
    "Measuring": "Qualität wird gemessen",
}
