"""The add-on's words in German: by the words in the code, those of settings by their names."""

# Labels and buttons.
LABELS = {
    "Objects": "Objekte",
    "Source": "Quelle",
    "Target": "Ziel",
    "Take Selected": "Auswahl nehmen",
    "Swap": "Tauschen",
    "Manual": "Handbuch",
    "Features": "Merkmale",
    "Feature": "Merkmal",
    "Click Features": "Merkmale anklicken",
    "Add Feature": "Merkmal hinzufügen",
    "Remove Feature": "Merkmal entfernen",
    "Jump to Feature": "Zum Merkmal springen",
    "Pair by Name": "Paaren",
    "Propose": "Vorschlagen",
    "Check Features": "Merkmale prüfen",
    "Move by Clicks": "Durch Klicks verschieben",
    "Markers": "Markierungen",
    "Name": "Name",
    "Marked Name": "Markierter Name",
    "On Source": "Auf der Quelle",
    "On Target": "Auf dem Ziel",
    "Use": "Verwenden",
    "Color": "Farbe",
    "Confidence": "Sicherheit",
    "Found": "Gefunden",
    "Active Feature": "Gewähltes Merkmal",
    "Places Between": "Stellen dazwischen",
    "All Vertex Groups": "Alle Vertexgruppen",
    "On": "Auf",
    "Kind": "Art",
    "Hold": "Halten",
    "Weight": "Gewicht",
    "Automatic": "Automatisch",
    "Point": "Punkt",
    "Curve": "Kurve",
    "Region": "Bereich",
    "Exactly": "Genau",
    "Softly": "Weich",
    "Cut and Domain": "Schnitt und Grundfläche",
    "Cut closed models along:": "Geschlossene Modelle schneiden:",
    "Loop": "Schleife",
    "Add to Loop": "Zur Schleife hinzufügen",
    "Remove from Loop": "Aus der Schleife nehmen",
    "Move in Loop": "In der Schleife verschieben",
    "Clear Loop": "Schleife leeren",
    "Propose Loop": "Schleife vorschlagen",
    "Show Cut": "Schnitt zeigen",
    "Active": "Gewählt",
    "Direction": "Richtung",
    "Up": "Hinauf",
    "Down": "Hinunter",
    "Remove": "Entfernen",
    "Morph": "Verwandeln",
    "Esc stops it": "Esc hält an",
    "Stopping": "Wird angehalten",
    "Reading the scene": "Die Szene wird gelesen",
    "Preview: the whole is being computed": "Vorschau: das Ganze wird berechnet",
    "Chain": "Kette",
    "Add Selected": "Auswahl hinzufügen",
    "Change the Chain": "Kette ändern",
    "Change": "Änderung",
    "Morph the Chain": "Kette verwandeln",
    "Via": "Über",
    "Active Shape": "Gewählte Form",
    "Object": "Objekt",
    "Result": "Ergebnis",
    "Quality": "Güte",
    "Show Distortion": "Verzerrung zeigen",
    "No place stands out": "Keine Stelle fällt auf",
    "Go to the Place": "Zur Stelle gehen",
    "Place": "Stelle",
    "Bake": "Backen",
    "Bake As": "Backen als",
    "Shape Keys": "Formschlüssel",
    "Frames": "Einzelbilder",
    "Steps": "Schritte",
    "On the Source Mesh": "Auf das Quellnetz",
    "On the Morph Object": "Auf das Ergebnis",
    "Source Mesh": "Quellnetz",
    "Morph Object": "Ergebnisobjekt",
    "Bake Shape Keys": "Formschlüssel backen",
    "Bake Frames": "Einzelbilder backen",
    "Format": "Format",
    "Folder": "Ordner",
    "In the Scene": "In der Szene",
    "PLY Files": "PLY-Dateien",
    "USD": "USD",
    "Alembic": "Alembic",
    "Easing": "Verlauf",
    "Even": "Gleichmäßig",
    "Smooth": "Sanft",
    "Re-sample": "Neu abtasten",
    "Faces": "Flächen",
    "First": "Erstes",
    "Last": "Letztes",
    "Step": "Schrittweite",
    "As Set": "Wie eingestellt",
    "Recompute": "Neu berechnen",
    "Edit This Morph": "Wieder bearbeiten",
    "Follow": "Folgen",
    "Mesh of the Source": "Netz der Quelle",
    "Bring Over from Target": "Vom Ziel übernehmen",
    "Colours": "Farben",
    "Weights": "Gewichte",
    "UV Maps": "UV-Karten",
    "Prefix": "Vorsatz",
    "Looking whether it is up to date": "Es wird nachgesehen, ob es noch stimmt",
    "Up to date": "Auf dem neuesten Stand",
    "Out of date": "Veraltet",
    "Without its objects": "Ohne seine Objekte",
    "Not known whether up to date": "Unbekannt, ob es noch stimmt",
    "Advanced": "Für Fortgeschrittene",
    "Pointmorph Demo": "Pointmorph-Beispiel",
}

# Tooltips.
TIPS = {
    "Take the two selected objects: the active one, which was selected last, is the target": (
        "Nimmt die beiden ausgewählten Objekte: das aktive, zuletzt gewählte, ist das Ziel"
    ),
    "Make the target the source and the source the target": "Vertauscht Quelle und Ziel",
    "Open the manual that came with the add-on": "Öffnet das mitgelieferte Handbuch",
    "Add two animals of different proportions, marked and picked: press Morph in the sidebar": (
        "Fügt zwei Tiere verschiedener Gestalt hinzu, markiert und gewählt: in der Seitenleiste "
        "Verwandeln drücken"
    ),
    # Features
    "Mark the selected vertices as a feature: on each picked object in Edit Mode, or the active. "
    "One is a point, a path of edges a curve, any other several are a region": (
        "Markiert die ausgewählten Vertices als Merkmal: auf jedem gewählten Objekt im "
        "Bearbeitungsmodus oder auf dem aktiven. Einer ist ein Punkt, ein Weg aus Kanten eine "
        "Kurve, alle anderen sind ein Bereich"
    ),
    "The feature's name. Without one, the first feature of the list that isn't marked here yet is "
    "completed, or a new one begun": (
        "Name des Merkmals. Ohne ihn wird das erste der Liste ergänzt, das hier noch unmarkiert "
        "ist, oder ein neues begonnen"
    ),
    "Look at what is marked on both objects, and say in the list what each feature is": (
        "Sieht nach, was auf beiden Objekten markiert ist, und schreibt in die Liste, was jedes "
        "Merkmal ist"
    ),
    "Remove the feature chosen in the list, on both objects": (
        "Entfernt das in der Liste gewählte Merkmal von beiden Objekten"
    ),
    "The feature's name; without one, that which is chosen in the list": (
        "Name des Merkmals; ohne ihn das in der Liste gewählte"
    ),
    "Find tips and other places that belong together and mark them on both objects, to check": (
        "Findet Spitzen und andere Stellen, die zusammengehören, und markiert sie zur Prüfung auf "
        "beiden Objekten"
    ),
    "Less likely pairs aren't marked": "Weniger wahrscheinliche Paare werden nicht markiert",
    "Mark places between the tips too": "Auch Stellen zwischen den Spitzen markieren",
    "Make features of what has the same name on both objects: marks whose names differ in "
    "capitals, spaces and dots alone and, where asked for, vertex groups without the prefix": (
        "Macht Merkmale aus dem, was auf beiden Objekten gleich heißt: Marken, deren Namen sich "
        "nur in Großschreibung, Leerzeichen und Punkten unterscheiden, und auf Wunsch "
        "Vertexgruppen ohne den Vorsatz"
    ),
    "Take vertex groups without the prefix too, such as those of a rig: each is copied as a "
    "feature, a region where it holds several vertices": (
        "Nimmt auch Vertexgruppen ohne den Vorsatz, etwa die eines Rigs: jede wird als Merkmal "
        "kopiert, als Bereich, wo sie mehrere Vertices enthält"
    ),
    "Look at the feature chosen in the list: the view and the 3D cursor go there": (
        "Zeigt das in der Liste gewählte Merkmal: Ansicht und 3D-Cursor gehen dorthin"
    ),
    "The object on which to look at it": "Das Objekt, auf dem es gezeigt wird",
    "Where it is on the source": "Wo es auf der Quelle ist",
    "Where it is on the target": "Wo es auf dem Ziel ist",
    "Mark features by clicks: a place on one object, then the same place on the other. Ctrl Z "
    "takes a click back; Esc or right click ends it": (
        "Markiert Merkmale durch Klicks: eine Stelle auf einem Objekt, dann dieselbe auf dem "
        "anderen. Strg Z nimmt einen Klick zurück; Esc oder die rechte Taste beendet es"
    ),
    "What the feature chosen in the list is, and how it is held": (
        "Was das in der Liste gewählte Merkmal ist und wie es gehalten wird"
    ),
    "The name on the objects, without the prefix": "Der Name auf den Objekten, ohne den Vorsatz",
    "The source has the vertex group of this feature": (
        "Die Quelle hat die Vertexgruppe dieses Merkmals"
    ),
    "The target has the vertex group of this feature": (
        "Das Ziel hat die Vertexgruppe dieses Merkmals"
    ),
    "Off: the morph takes no notice of this feature, and its marks stay": (
        "Aus: die Verwandlung beachtet dieses Merkmal nicht, und seine Marken bleiben"
    ),
    "The colour of its marks in the viewport": "Die Farbe seiner Marken in der Ansicht",
    "How likely a proposed pair is right; below 0 for a mark of the user's own": (
        "Wie wahrscheinlich ein vorgeschlagenes Paar stimmt; unter 0 bei eigenen Marken"
    ),
    "What is marked": "Was markiert ist",
    "One vertex is a point; several that edges join to a path, open or closed, are a curve; any "
    "other several are a region": (
        "Ein Vertex ist ein Punkt; mehrere, die Kanten zu einem offenen oder geschlossenen Weg "
        "verbinden, sind eine Kurve; alle anderen sind ein Bereich"
    ),
    "One place goes onto one place: the vertex of highest weight": (
        "Eine Stelle geht auf eine Stelle: der Vertex mit dem höchsten Gewicht"
    ),
    "A path goes onto a path by share of the length. Without edges the weights say the order, the "
    "heaviest first": (
        "Ein Weg geht auf einen Weg, nach dem Anteil an der Länge. Ohne Kanten sagen die Gewichte "
        "die Reihenfolge, das schwerste zuerst"
    ),
    "What is inside goes inside, however many vertices; painted weights go onto the same weights": (
        "Was darin ist, kommt hinein, wie viele Vertices es auch sind; gemalte Gewichte gehen auf "
        "dieselben Gewichte"
    ),
    "Whether the feature must be met, or may give way": (
        "Ob das Merkmal getroffen werden muss oder nachgeben darf"
    ),
    "Points exactly, but softly where the weight of the vertex is below 1; curves and regions "
    "softly": (
        "Punkte genau, aber weich, wo das Gewicht des Vertex unter 1 liegt; Kurven und Bereiche "
        "weich"
    ),
    "The feature is met, whatever that does to its surroundings": (
        "Das Merkmal wird getroffen, was immer das mit seiner Umgebung macht"
    ),
    "The feature pulls, and may give way to the shapes": (
        "Das Merkmal zieht und darf den Formen nachgeben"
    ),
    "How strongly the feature pulls where it is held softly: 1 mostly has its way, 0.1 goes about "
    "half": (
        "Wie stark das Merkmal zieht, wo es weich gehalten wird: 1 setzt sich meist durch, 0.1 "
        "kommt etwa halb so weit"
    ),
    "What the feature was when it was last looked at: by Check or Morph": (
        "Was das Merkmal war, als zuletzt nachgesehen wurde: beim Prüfen oder Verwandeln"
    ),
    "The feature that is chosen in the list": "Das in der Liste gewählte Merkmal",
    "Show the marks of all features in the viewport, numbered as in the list; pale on the far "
    "side": (
        "Zeigt die Marken aller Merkmale in der Ansicht, nummeriert wie in der Liste; auf der "
        "abgewandten Seite blass"
    ),
    "The feature to mark or to move. Without one, those that are marked on one object only are "
    "completed, and then new ones made": (
        "Das Merkmal, das markiert oder verschoben wird. Ohne eines werden die ergänzt, die nur "
        "auf einem Objekt markiert sind, und dann neue gemacht"
    ),
    # The cut
    "Add a feature to the loop, after the one that is chosen there": (
        "Fügt der Schleife ein Merkmal hinzu, nach dem dort gewählten"
    ),
    "The feature; without one, that which is chosen in the list of features": (
        "Das Merkmal; ohne eines das in der Liste der Merkmale gewählte"
    ),
    "Take the chosen feature out of the loop; it stays a feature": (
        "Nimmt das gewählte Merkmal aus der Schleife; es bleibt ein Merkmal"
    ),
    "Have the loop pass the chosen feature earlier or later": (
        "Lässt die Schleife früher oder später durch das gewählte Merkmal gehen"
    ),
    "Where to in the list": "Wohin in der Liste",
    "One earlier": "Eins früher",
    "One later": "Eins später",
    "Empty the loop; the features stay": "Leert die Schleife; die Merkmale bleiben",
    "Find an order in which a curve runs through the features on tips of both, and show it": (
        "Findet eine Reihenfolge, in der eine Kurve durch die Merkmale auf den Spitzen beider "
        "läuft, und zeigt sie"
    ),
    "Show on both objects where the loop would cut them; once more, and it's hidden": (
        "Zeigt auf beiden Objekten, wo die Schleife sie schneiden würde; noch einmal, und es ist "
        "verborgen"
    ),
    "Features, in order, through which a closed model is cut": (
        "Merkmale, der Reihe nach, durch die ein geschlossenes Modell geschnitten wird"
    ),
    "The feature of the loop that is chosen in its list": (
        "Das Merkmal der Schleife, das in ihrer Liste gewählt ist"
    ),
    # The morph
    "What the morph starts from: a mesh or a point cloud. Of a mesh, the vertices without "
    "modifiers are taken, because shape keys are put on these": (
        "Womit die Verwandlung beginnt: ein Netz oder eine Punktwolke. Von einem Netz werden die "
        "Vertices ohne Modifikatoren genommen, weil diese die Formschlüssel bekommen"
    ),
    "What the morph ends at: a mesh or a point cloud, taken as the viewport shows it, with "
    "modifiers and shape keys": (
        "Womit die Verwandlung endet: ein Netz oder eine Punktwolke, wie die Ansicht es zeigt, mit "
        "Modifikatoren und Formschlüsseln"
    ),
    "Places that source and target have in common": "Stellen, die Quelle und Ziel beide haben",
    "Compute the morph from source to target. In a window Blender stays usable; Esc stops it": (
        "Berechnet die Verwandlung der Quelle ins Ziel. Blender bleibt dabei benutzbar; Esc hält an"
    ),
    "Colour the points by how bad the map is: blue good, yellow bad, red folded; or undo that": (
        "Färbt die Punkte danach, wie schlecht die Abbildung ist: blau gut, gelb schlecht, rot "
        "gefaltet; oder nimmt das zurück"
    ),
    "Put the 3D cursor where the morph is bad": (
        "Setzt den 3D-Cursor dorthin, wo die Verwandlung schlecht ist"
    ),
    "0 for the worst": "0 ist die schlechteste",
    # Bakes
    "What the morph becomes": "Was aus der Verwandlung wird",
    "Keys on the source mesh, or on the morph object": (
        "Schlüssel auf dem Quellnetz oder dem Ergebnisobjekt"
    ),
    "A cloud for each frame, in the scene or as files": (
        "Eine Wolke für jedes Einzelbild, in der Szene oder als Dateien"
    ),
    "Add the morph as shape keys; those that are there already stay": (
        "Fügt die Verwandlung als Formschlüssel hinzu; die schon da sind, bleiben"
    ),
    "What gets the shape keys": "Was die Formschlüssel bekommt",
    "The source itself: its faces, materials and weights stay, and the key makes it look like the "
    "target": (
        "Die Quelle selbst: Flächen, Materialien und Gewichte bleiben, und der Schlüssel lässt sie "
        "wie das Ziel aussehen"
    ),
    "The points of the morph object, which show every vertex of both": (
        "Die Punkte des Ergebnisobjekts, die jeden Vertex von beiden zeigen"
    ),
    "How vertices travel from step to step. A single key is straight in any case": (
        "Wie die Vertices von Schritt zu Schritt wandern. Ein einzelner Schlüssel ist immer gerade"
    ),
    "How points travel": "Wie die Punkte wandern",
    "The setting Path in the panel": "Die Einstellung Weg im Feld",
    "Straight": "Gerade",
    "The whole turns and grows on the way": "Das Ganze dreht sich und wächst unterwegs",
    "Every part turns as well: limbs swing instead of shrinking": (
        "Auch jeder Teil dreht sich: Glieder schwingen, statt zu schrumpfen"
    ),
    "Number of shape keys, equally far from one another; the last is the target": (
        "Zahl der Formschlüssel, in gleichen Abständen; der letzte ist das Ziel"
    ),
    "Shape keys to bake, equally far from one another; the last one is the target": (
        "Formschlüssel, die gebacken werden, in gleichen Abständen; der letzte ist das Ziel"
    ),
    "Bake the morph frame by frame, with new points where it would show cracks": (
        "Backt die Verwandlung Bild für Bild, mit neuen Punkten, wo Risse wären"
    ),
    "Where the frames go": "Wohin die Einzelbilder kommen",
    "An object that shows the frame of the scene": "Ein Objekt, das das Bild der Szene zeigt",
    "One file a frame with all there is, id and velocity too": (
        "Eine Datei für jedes Bild mit allem, auch Nummer und Geschwindigkeit"
    ),
    "One file with all there is. Points from Blender 4.5 on": (
        "Eine Datei mit allem. Punkte ab Blender 4.5"
    ),
    "One file: positions, as vertices, and velocity": (
        "Eine Datei: Orte, als Vertices, und Geschwindigkeit"
    ),
    "Frame that shows the source": "Bild, das die Quelle zeigt",
    "Frame that shows the target": "Bild, das das Ziel zeigt",
    "Frames from one to the next": "Bilder von einem zum nächsten",
    "How the morph runs over the frames": "Wie die Verwandlung über die Bilder läuft",
    "At the same speed all the time": "Immer gleich schnell",
    "Begins and ends slowly": "Beginnt und endet langsam",
    "Put new points where there would be cracks": "Setzt neue Punkte, wo Risse wären",
    "A mesh for every frame, the surface through its points, instead of points; beside the points "
    "for PLY. Needs pymeshlab and scipy in Blender's Python": (
        "Ein Netz für jedes Bild, die Fläche durch seine Punkte, anstelle der Punkte; bei PLY "
        "daneben. Braucht pymeshlab und scipy in Blenders Python"
    ),
    "A mesh for every frame, the surface through its points, instead of points. Needs pymeshlab "
    "and scipy in Blender's Python": (
        "Ein Netz für jedes Bild, die Fläche durch seine Punkte, anstelle der Punkte. Braucht "
        "pymeshlab und scipy in Blenders Python"
    ),
    "Where files go": "Wohin die Dateien kommen",
    "Folder for the files; // is that of the blend file": (
        "Ordner für die Dateien; // ist der der Blend-Datei"
    ),
    # The morph object, chains
    "Compute this morph again in place, from the objects as they are now. Name, t with its keys "
    "and drivers, materials and baked keys stay": (
        "Berechnet diese Verwandlung an Ort und Stelle neu, aus den Objekten, wie sie jetzt sind. "
        "Name, t mit Schlüsseln und Treibern, Materialien und gebackene Schlüssel bleiben"
    ),
    "Pick the objects of this morph in the panel again, with its settings and features": (
        "Wählt die Objekte dieser Verwandlung wieder im Feld, mit ihren Einstellungen und Merkmalen"
    ),
    "Let the points follow how the objects that were morphed move and deform: armatures, shape "
    "keys, modifiers; or show what was morphed again": (
        "Lässt die Punkte folgen, wie sich die verwandelten Objekte bewegen und verformen: "
        "Armaturen, Formschlüssel, Modifikatoren; oder zeigt wieder, was verwandelt wurde"
    ),
    "Make a copy of the source that morphs: with its faces, materials, colours, UV maps, weights "
    "and modifiers, and a t of its own": (
        "Macht eine Kopie der Quelle, die sich verwandelt: mit Flächen, Materialien, Farben, "
        "UV-Karten, Gewichten und Modifikatoren und einem eigenen t"
    ),
    "Bring colours, weights and UV maps of the target over, to where its surface lands": (
        "Übernimmt Farben, Gewichte und UV-Karten des Ziels dorthin, wo seine Oberfläche landet"
    ),
    "Colour attributes. A mesh of the source shows them more and more with t": (
        "Farbattribute. Ein Netz der Quelle zeigt sie mit t mehr und mehr"
    ),
    "Vertex groups, except features": "Vertexgruppen, außer Merkmalen",
    "As point attributes: faces that lie across a seam of the target are smeared": (
        "Als Punktattribute: Flächen über einer Naht des Ziels verwischen"
    ),
    "Goes before the target's names, so that the source's own stay": (
        "Steht vor den Namen des Ziels, damit die eigenen der Quelle bleiben"
    ),
    "A mesh or a point cloud": "Ein Netz oder eine Punktwolke",
    "Shapes that a chain goes through between source and target, in order": (
        "Formen, durch die eine Kette zwischen Quelle und Ziel geht, der Reihe nach"
    ),
    "The shape between that is chosen in the list": "Die in der Liste gewählte Form dazwischen",
    "Add the selected objects, in the order of their names, as shapes between source and target; "
    "or the source and the target too when none is picked yet": (
        "Fügt die ausgewählten Objekte in der Reihenfolge ihrer Namen als Formen zwischen Quelle "
        "und Ziel hinzu; auch Quelle und Ziel, wenn noch keine gewählt sind"
    ),
    "Move the shape chosen in the list, or take it out of the chain": (
        "Verschiebt die in der Liste gewählte Form oder nimmt sie aus der Kette"
    ),
    "What happens to the shape": "Was mit der Form geschieht",
    "Towards the source": "Zur Quelle hin",
    "Towards the target": "Zum Ziel hin",
    "Out of the chain; the object stays": "Aus der Kette; das Objekt bleibt",
    "Compute the morph from the source over all the shapes between to the target, as one object. "
    "In a window Blender stays usable; Esc stops it": (
        "Berechnet die Verwandlung von der Quelle über alle Formen dazwischen zum Ziel, als ein "
        "Objekt. Blender bleibt dabei benutzbar; Esc hält an"
    ),
}

# What is said: why a button is greyed, what was done, what happens. Names stand in braces.
MESSAGES = {
    "A morph is being computed: wait, or press Esc to stop it": (
        "Eine Verwandlung wird berechnet: warten, oder Esc zum Anhalten"
    ),
    "Something is being computed: wait, or press Esc to stop it": (
        "Es wird gerechnet: warten, oder Esc zum Anhalten"
    ),
    "Pick a source first": "Erst eine Quelle wählen",
    "Pick a target first": "Erst ein Ziel wählen",
    "Pick a source or a target first": "Erst eine Quelle oder ein Ziel wählen",
    'The source "{name}" is no longer in the scene: pick another': (
        "Die Quelle „{name}“ ist nicht mehr in der Szene: eine andere wählen"
    ),
    'The target "{name}" is no longer in the scene: pick another': (
        "Das Ziel „{name}“ ist nicht mehr in der Szene: ein anderes wählen"
    ),
    '"{name}" is no longer in the scene: pick another': (
        "„{name}“ ist nicht mehr in der Szene: ein anderes wählen"
    ),
    'Source and target are both "{name}": pick two objects': (
        "Quelle und Ziel sind beide „{name}“: zwei Objekte wählen"
    ),
    "Select two meshes or point clouds, the target last": (
        "Zwei Netze oder Punktwolken auswählen, das Ziel zuletzt"
    ),
    "Morph first, or make a morph object the active object": (
        "Erst verwandeln, oder ein Ergebnisobjekt zum aktiven Objekt machen"
    ),
    "This is a preview: wait for the whole": "Das ist eine Vorschau: auf das Ganze warten",
    "Leave Edit Mode first": "Erst den Bearbeitungsmodus verlassen",
    "This morph was made without it, or lost its points: morph again": (
        "Diese Verwandlung wurde ohne das gemacht oder hat ihre Punkte verloren: neu verwandeln"
    ),
    "This morph has no bad places": "Diese Verwandlung hat keine schlechten Stellen",
    '"{name}" is linked from another file: make it local first': (
        "„{name}“ ist aus einer anderen Datei verknüpft: erst lokal machen"
    ),
    '"{name}" is linked from another file: make it local to mark it': (
        "„{name}“ ist aus einer anderen Datei verknüpft: zum Markieren lokal machen"
    ),
    'The points of "{name}" are made by nodes: make them real to mark them': (
        "Die Punkte von „{name}“ werden von Knoten gemacht: zum Markieren echt machen"
    ),
    'Leave the mode that "{name}" is in first (Tab)': (
        "Erst den Modus verlassen, in dem „{name}“ ist (Tab)"
    ),
    "Make the morph object the active object: this is a mesh that was made from it": (
        "Das Ergebnisobjekt zum aktiven Objekt machen: dies ist ein Netz, das daraus gemacht wurde"
    ),
    "Add shapes between source and target first": (
        "Erst Formen zwischen Quelle und Ziel hinzufügen"
    ),
    "Pick an object for the source, the target and every shape between": (
        "Für Quelle, Ziel und jede Form dazwischen ein Objekt wählen"
    ),
    '"{name}" follows itself: take one of both out': (
        "„{name}“ folgt auf sich selbst: eines von beiden herausnehmen"
    ),
    "A chain has at most {most} shapes, and there are {count}": (
        "Eine Kette hat höchstens {most} Formen, und es sind {count}"
    ),
    "Select meshes or point clouds that aren't source or target": (
        "Netze oder Punktwolken auswählen, die nicht Quelle oder Ziel sind"
    ),
    "There is no shape between source and target": "Zwischen Quelle und Ziel ist keine Form",
    "Make the source or the target the active object, and select vertices": (
        "Quelle oder Ziel zum aktiven Objekt machen und Vertices auswählen"
    ),
    "There is no feature yet": "Es gibt noch kein Merkmal",
    "Choose a feature in the list": "Ein Merkmal in der Liste wählen",
    "Choose a feature of the loop": "Ein Merkmal der Schleife wählen",
    "List at least three features in the loop, or let one be proposed": (
        "Mindestens drei Merkmale in die Schleife setzen, oder eine vorschlagen lassen"
    ),
    '"{name}" isn\'t marked on both objects: take it out of the loop, or mark it': (
        "„{name}“ ist nicht auf beiden Objekten markiert: aus der Schleife nehmen oder markieren"
    ),
    '"{name}" isn\'t marked on {object}': "„{name}“ ist auf {object} nicht markiert",
    '"{name}" holds no vertex of {object}': "„{name}“ enthält keinen Vertex von {object}",
    "It waits for clicks already: Esc ends it": "Es wartet schon auf Klicks: Esc beendet es",
    "Clicks need a window: use add_feature in scripts": (
        "Klicks brauchen ein Fenster: in Skripten add_feature nehmen"
    ),
    'Click on "{source}" or "{target}"': "Auf „{source}“ oder „{target}“ klicken",
    '"{name}" is there already: click another vertex': (
        "Dort ist schon „{name}“: auf einen anderen Vertex klicken"
    ),
    '"{name}": click the same place on {object}': (
        "„{name}“: dieselbe Stelle auf {object} anklicken"
    ),
    'New "{name}": click a place on {source} or {target}': (
        "Neu „{name}“: eine Stelle auf {source} oder {target} anklicken"
    ),
    '"{name}": click where it belongs': "„{name}“: anklicken, wohin es gehört",
    "{text}     Ctrl Z: take back     Esc: done": "{text}     Strg Z: zurück     Esc: fertig",
    "Source or target were exchanged meanwhile: propose again": (
        "Quelle oder Ziel wurden inzwischen getauscht: neu vorschlagen"
    ),
    "{count} of {all} proposals marked: check them": (
        "{count} von {all} Vorschlägen markiert: bitte prüfen"
    ),
    "{count} of {all} proposals marked; the rest is too unsure": (
        "{count} von {all} Vorschlägen markiert; der Rest ist zu unsicher"
    ),
    "Features: {count}": "Merkmale: {count}",
    "Pairs found: {count}": "Paare gefunden: {count}",
    "Loop: {names}": "Schleife: {names}",
    "Press Morph in the sidebar (N), tab Pointmorph": (
        "In der Seitenleiste (N), Reiter Pointmorph, Verwandeln drücken"
    ),
    "The manual isn't at {path}: install the add-on anew": (
        "Das Handbuch ist nicht unter {path}: das Add-on neu installieren"
    ),
    "Something was removed meanwhile: start again": (
        "Inzwischen wurde etwas entfernt: neu anfangen"
    ),
    "The morph was stopped": "Die Verwandlung wurde angehalten",
    "The chain was stopped": "Die Kette wurde angehalten",
    "The search was stopped": "Die Suche wurde angehalten",
    "The search for the cut was stopped": "Die Suche nach dem Schnitt wurde angehalten",
    "It was stopped: the morph is as it was": "Angehalten: die Verwandlung ist, wie sie war",
    "It was stopped: nothing was brought over": "Angehalten: nichts wurde übernommen",
    "The bake was stopped. Frames that are done wait: bake again to go on": (
        "Das Backen wurde angehalten. Fertige Bilder warten: noch einmal backen setzt fort"
    ),
    '"{name}": {pairs} pairs in {seconds} s': "„{name}“: {pairs} Paare in {seconds} s",
    '"{name}" is gone: the points that the morph holds were used': (
        "„{name}“ ist weg: die Punkte, die das Ergebnis enthält, wurden genommen"
    ),
    '"{name}" has the faces of "{source}"': "„{name}“ hat die Flächen von „{source}“",
    "Brought over: {names}": "Übernommen: {names}",
    'Shape keys added to "{name}": {count}': "Formschlüssel zu „{name}“ hinzugefügt: {count}",
    "{count} frames written to {place}": "{count} Bilder nach {place} geschrieben",
    '{count} frames in "{name}"': "{count} Bilder in „{name}“",
    # What has changed since a morph was made
    "made by an earlier version, which kept no settings": (
        "von einer früheren Version, die keine Einstellungen behielt"
    ),
    '"{name}" is gone': "„{name}“ ist weg",
    '"{name}" has {now} points instead of {before}': "„{name}“ hat {now} Punkte statt {before}",
    '"{name}" was edited': "„{name}“ wurde bearbeitet",
    '"{name}" looks different: its modifiers or shape keys were changed': (
        "„{name}“ sieht anders aus: Modifikatoren oder Formschlüssel wurden geändert"
    ),
    'features on "{name}" were changed': "Merkmale auf „{name}“ wurden geändert",
    '"{name}" was moved, turned or scaled': "„{name}“ wurde bewegt, gedreht oder skaliert",
    "setting {name} was changed": "Einstellung {name} wurde geändert",
    'feature "{name}" is held in another way': "Merkmal „{name}“ wird anders gehalten",
    "the loop was changed": "die Schleife wurde geändert",
}

# Of the library's settings, by name: the label, and what it's for.
SETTINGS = {
    "method": (
        "Verfahren",
        "Wie die Zuordnung gefunden wird: Auto biegt beide Modelle nahezu starr aufeinander, was "
        "immer ihre Topologie ist; Paper nimmt das veröffentlichte Verfahren und nichts sonst",
    ),
    "domain": (
        "Grundfläche",
        "Worauf beide Modelle übereinandergelegt werden: Scheibe ist für offene Stücke mit einem "
        "Rand, Schnitt für geschlossene Modelle und eine Schleife von Merkmalen, an der sie in "
        "zwei geteilt werden (ohne sie die Merkmale auf Spitzen), Kugel für geschlossene Modelle "
        "ohne Löcher, ungeschnitten; Netz für geschlossene Modelle jeder Art, an Kurven zwischen "
        "allen Merkmalen in viele Stücke geteilt; Auto nimmt, was Verfahren und Modelle verlangen. "
        "Beim Verfahren Auto sagt es, womit die Verfeinerung beginnt",
    ),
    "threads": (
        "Threads",
        "Wie viele Threads rechnen; 0 nimmt alle. Das Ergebnis ist bei jeder Zahl dasselbe",
    ),
    "covariance_neighbors": (
        "Nachbarn für Normalen",
        "Nächste Punkte, aus denen Normalen und Rand gefunden werden. Für verrauschte Scans "
        "erhöhen, für dünne oder feine Modelle senken",
    ),
    "boundary_opening": (
        "Öffnung am Rand",
        "Wie viel weiter als die übliche Lücke zwischen Punkten eine Öffnung sein muss, um als "
        "Rand zu zählen. Erhöhen, wenn Lücken der Abtastung für einen gehalten werden, senken, "
        "wenn ein Rand übersehen wird",
    ),
    "boundary_min_loop": (
        "Kürzester Rand",
        "Kürzere Randschleifen gelten als Lücken der Abtastung",
    ),
    "boundary_spacing": (
        "Verteilung am Rand",
        "Wie Randpunkte über den Kreis verteilt werden: gleichmäßig oder nach ihrem Abstand. "
        "Gleichmäßig passt, wenn die Ränder beider Modelle gleich abgetastet sind",
    ),
    "solve": (
        "Lösen",
        "Die Parametrisierung für alle Punkte lösen (langsam), oder für eine vereinfachte Wolke, "
        "in die danach alle Punkte eingebettet werden",
    ),
    "decomposition_tips": (
        "Spitzen beim Schnitt",
        "Spitzen ohne Marke (Ohren, ein Schwanz), die auf geschnittenen Modellen gefunden und in "
        "den Stücken zusammengebracht werden, höchstens. 0 überlässt das den Marken",
    ),
    "sphere_nodes": (
        "Knoten der Kugel",
        "Etwa so viele Punkte jedes Modells werden vernetzt und auf die Kugel gelegt. Erhöhen, wo "
        "dünne Glieder verloren gehen, senken für mehr Tempo",
    ),
    "lod_cluster_size": (
        "Größe der Haufen",
        "Punkte, für die ein Punkt der vereinfachten Wolke höchstens steht. Kleiner ist feiner und "
        "langsamer",
    ),
    "parameterization_neighbors": (
        "Nachbarn der Parametrisierung",
        "Nächste Punkte, deren Mittel ein innerer Punkt auf der Scheibe ist. Erhöhen, wenn ein "
        "Stück zerfällt",
    ),
    "parameterization_radius": (
        "Radius der Parametrisierung",
        "Nimmt alle Punkte in diesem Umkreis statt der nächsten, wie die Veröffentlichung. "
        "Automatisch: die nächsten Punkte",
    ),
    "solver_tolerance": ("Genauigkeit des Lösers", "Relativer Rest, bei dem der Löser endet"),
    "solver_max_iterations": (
        "Schritte des Lösers",
        "Nach so vielen Schritten gibt der Löser auf",
    ),
    "alignment_error": (
        "Fehler der Ausrichtung",
        "Wie nah zwei Merkmale auf der Scheibe einander kommen müssen, in Abständen der Punkte um "
        "sie",
    ),
    "influence": (
        "Einfluss",
        "Umkreis eines Merkmals, der mitgeht, als Vielfaches seines Wegs. Größer ist glatter, "
        "kleiner örtlicher",
    ),
    "influence_radius": (
        "Radius des Einflusses",
        "Dasselbe als feste Entfernung auf der Scheibe. Automatisch: das Vielfache gilt",
    ),
    "alignment_max_sweeps": (
        "Durchgänge der Ausrichtung",
        "Abwechselnde Verzerrungen beider Scheiben, höchstens",
    ),
    "pairing_cluster_size": (
        "Haufen beim Paaren",
        "Punkte jedes Modells, die ein Haufen der Grundfläche beim Paaren enthalten darf",
    ),
    "transfer_neighbors": (
        "Nachbarn der Abbildung",
        "Punkte, über die die glatte Abbildung mittelt. Für verrauschte Scans erhöhen",
    ),
    "path": (
        "Weg",
        "Wie Punkte wandern: Linear geht gerade, Ähnlichkeit dreht und vergrößert das Ganze "
        "unterwegs (ein gedrehtes Ziel schrumpft nicht auf halbem Weg), Starr dreht auch jeden "
        "Teil, sodass ein gehobenes Bein schwingt. Formschlüssel selbst sind gerade: mehrere "
        "Schritte backen, um den anderen zu folgen",
    ),
    "omega": (
        "Omega",
        "Neu abgetastete Bilder bekommen Punkte, wo die Dichte unter diesen Anteil derer beider "
        "Enden fällt. 0 setzt keine, größer setzt früher welche",
    ),
    "resample_spacing": (
        "Abstand neuer Punkte",
        "Wie weit die neuen Punkte neu abgetasteter Bilder auseinanderliegen. Senken, wenn Bilder "
        "mit kleineren Punkten gezeichnet werden",
    ),
    "mls_degree": (
        "MLS-Grad",
        "Grad der Polynome, aus denen die Fläche besteht, auf der neue Punkte liegen",
    ),
    "mls_scale": (
        "MLS-Umkreis",
        "Wie weit die Fläche, auf der neue Punkte liegen, über die Punkte ringsum mittelt. Für "
        "verrauschte Scans erhöhen. Automatisch: 0.9 + Grad / 5",
    ),
    "mls_width": (
        "MLS-Breite",
        "Dasselbe als feste Entfernung. Automatisch: die Abstände gelten",
    ),
    "crowding": (
        "Gedränge",
        "Neu abgetastete Bilder lassen Punkte weg, wo die Dichte mehr als so viel Mal die jedes "
        "Endes ist. Automatisch: nie",
    ),
}

# What settings are counted in, and the values of those that are chosen from a list.
UNITS = {
    "threads": "Threads",
    "points": "Punkte",
    "spacings": "Abstände",
    "tips": "Spitzen",
    "iterations": "Schritte",
    "disk radii": "Scheibenradien",
    "sweeps": "Durchgänge",
    "model units": "Einheiten des Modells",
}
CHOICES = {
    "auto": "Auto",
    "paper": "Paper",
    "disk": "Scheibe",
    "cut": "Schnitt",
    "sphere": "Kugel",
    "network": "Netz",
    "uniform": "Gleichmäßig",
    "chord": "Nach Abstand",
    "full": "Alles",
    "lod": "Vereinfacht",
    "linear": "Linear",
    "similarity": "Ähnlichkeit",
    "rigid": "Starr",
}
