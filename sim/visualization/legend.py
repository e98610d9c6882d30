"""Explains the colours and signs of a scene, those that it shows and no others."""

from collections.abc import Collection

from matplotlib import artist, patches

from . import objects, roads


def handles(shown: Collection[str]) -> list[artist.Artist]:
    """Returns the entries of a legend for the words that `scene.draw` returns."""
    return [entry for word, entry in _entries().items() if word in shown]


def _entries() -> dict[str, artist.Artist]:
    entries: dict[str, artist.Artist] = {
        "ego": patches.Patch(color=objects.EGO, label="ego"),
        "logged ego": patches.Patch(
            fill=False,
            edgecolor=objects.EGO,
            linestyle=(0, (3, 1.5)),
            label="logged ego",
        ),
    }
    for word, (color, _) in objects.KINDS.items():
        entries[word] = patches.Patch(color=color, label=word)
    for word, color in reversed(roads.ROUTES.items()):
        entries[word] = patches.Patch(color=color, label=word)
    for word in (roads.STOP_SIGN, *roads.LIGHTS):
        entries[word] = roads.sign(word)
    for word in objects.EVENT_MARKERS:
        entries[word] = objects.event_sign(word)
    return entries
