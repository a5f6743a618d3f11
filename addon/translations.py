"""The panel's words in other languages."""

import bpy

# By the words in the code, which Blender looks up: labels and buttons, then some of the tooltips.
_GERMAN = {
    "Objects": "Objekte",
    "Source": "Quelle",
    "Target": "Ziel",
    "Take Selected": "Auswahl nehmen",
    "Swap": "Tauschen",
    "Manual": "Handbuch",
    "Features": "Merkmale",
    "Click Features": "Merkmale anklicken",
    "Add Feature": "Merkmal hinzufügen",
    "Remove Feature": "Merkmal entfernen",
    "Jump to Feature": "Zum Merkmal springen",
    "Pair by Name": "Nach Namen paaren",
    "Propose": "Vorschlagen",
    "Check Features": "Merkmale prüfen",
    "Move by Clicks": "Durch Klicks verschieben",
    "Markers": "Markierungen",
    "Kind": "Art",
    "Hold": "Halten",
    "Weight": "Gewicht",
    "Curve": "Kurve",
    "Region": "Bereich",
    "Exactly": "Genau",
    "Softly": "Weich",
    "Cut and Domain": "Schnitt und Grundfläche",
    "Domain": "Grundfläche",
    "Cut closed models along:": "Geschlossene Modelle schneiden:",
    "Add to Loop": "Zur Schleife hinzufügen",
    "Remove from Loop": "Aus der Schleife nehmen",
    "Clear Loop": "Schleife leeren",
    "Propose Loop": "Schleife vorschlagen",
    "Show Cut": "Schnitt zeigen",
    "Morph": "Verwandeln",
    "Path": "Weg",
    "Press Esc over the viewport to stop": "Esc über der Ansicht hält an",
    "Preview: the whole is being computed": "Vorschau: das Ganze wird berechnet",
    "Result": "Ergebnis",
    "Quality": "Güte",
    "Show Distortion": "Verzerrung zeigen",
    "No place stands out": "Keine Stelle fällt auf",
    "Go to the Place": "Zur Stelle gehen",
    "Bake": "Backen",
    "Shape Keys": "Formschlüssel",
    "Frames": "Einzelbilder",
    "Steps": "Schritte",
    "On the Source Mesh": "Auf das Quellnetz",
    "On the Morph Object": "Auf das Ergebnis",
    "Bake Shape Keys": "Formschlüssel backen",
    "Bake Frames": "Einzelbilder backen",
    "Format": "Format",
    "Folder": "Ordner",
    "In the Scene": "In der Szene",
    "PLY Files": "PLY-Dateien",
    "Easing": "Verlauf",
    "Even": "Gleichmäßig",
    "Smooth": "Sanft",
    "Re-sample": "Neu abtasten",
    "First": "Erstes",
    "Last": "Letztes",
    "Advanced": "Für Fortgeschrittene",
    "Pointmorph Demo": "Pointmorph-Beispiel",
    "Take the two selected objects: the active one, which was selected last, is the target": (
        "Nimmt die beiden ausgewählten Objekte: das aktive, zuletzt gewählte, ist das Ziel"
    ),
    "Make the target the source and the source the target": "Vertauscht Quelle und Ziel",
    "Remove the feature chosen in the list, on both objects": (
        "Entfernt das in der Liste gewählte Merkmal von beiden Objekten"
    ),
    "Compute the morph from source to target. In a window Blender stays usable; Esc stops it": (
        "Berechnet die Verwandlung der Quelle ins Ziel. Blender bleibt dabei benutzbar; Esc hält an"
    ),
    "Open the manual that came with the add-on": "Öffnet das mitgelieferte Handbuch",
}


def words():
    """All words that are translated, by language."""
    return {"de_DE": _GERMAN}


def _dictionary():
    """As Blender wants it: labels and tooltips have no context, names of operators have one."""
    return {
        language: {
            (context, word): text for word, text in known.items() for context in ("*", "Operator")
        }
        for language, known in words().items()
    }


def register():
    bpy.app.translations.register(__name__, _dictionary())


def unregister():
    bpy.app.translations.unregister(__name__)
