"""Models that face different ways: what is up is told from where they look."""

import numpy as np
import pointmorph
import pytest
import trimesh

X, Y, Z = np.eye(3)
SPHERE = trimesh.creation.icosphere(4)


def _wavy(tip):
    """An egg with waves all over and a thin tip."""
    ways = SPHERE.vertices
    rows = np.sin(8 * np.arcsin(np.clip(ways[:, 2], -1, 1)))
    waves = 1 + 0.2 * rows * np.cos(4 * np.arctan2(ways[:, 1], ways[:, 0]))
    radii = waves * (1 + 2 * np.exp((ways @ tip - 1) / 0.03))
    return radii[:, None] * ways * [1, 1, 1.2]


def _box(tip):
    """A box with a thicker tip."""
    ways = SPHERE.vertices
    radii = (np.abs(ways) ** 6).sum(1) ** (-1 / 6) * (1 + 2.5 * np.exp((ways @ tip - 1) / 0.05))
    return radii[:, None] * ways


def _image_of_tip(up, tip, axis=2):
    """Where the egg's tip goes, as a direction; `axis` is where z is in what is morphed."""
    source, target = _wavy(X), _box(tip)
    clouds = [
        pointmorph.Cloud(np.roll(positions, axis - 2, axis=1), faces=SPHERE.faces)
        for positions in (source, target)
    ]
    images = pointmorph.morph(*clouds, up=up).source_to_target
    image = np.roll(images[source[:, 0].argmax()], 2 - axis)
    return image / np.linalg.norm(image)


@pytest.mark.parametrize("tip", [Y, -X], ids=["left", "back"])
def test_models_that_have_little_in_common_may_face_different_ways(tip):
    assert _image_of_tip("none", tip) @ tip < 0.8
    assert _image_of_tip("z", tip) @ tip > 0.95


def test_they_are_not_tilted():
    assert _image_of_tip("z", Z) @ Z < 0.8


@pytest.mark.parametrize("axis", [0, 1])
def test_any_axis_may_be_up(axis):
    assert _image_of_tip("xyz"[axis], Y, axis) @ Y > 0.95
