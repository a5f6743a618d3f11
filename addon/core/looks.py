"""What surfaces look like: what a material says of color, roughness and so on, and what that is at
places of a mesh."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from . import textures

_WEIGHTS = np.array([0.2126, 0.7152, 0.0722], np.float32)  # of a color's brightness

# --- What there is at a place ---------------------------------------------------------------------


@dataclass(frozen=True)
class Samples:
    """Places of a mesh: the corners of its faces around each, and their shares.

    Attributes
    ----------
    look : Look
    corners : (N, K) array of int
    shares : (N, K) array
    """

    look: "Look"
    corners: np.ndarray
    shares: np.ndarray

    def __len__(self):
        return len(self.corners)

    def uvs(self, name):
        return self._mean(self.look.uvs[name])

    def colors(self, name):
        """Of a color attribute."""
        return self._mean(self.look.colors[name])

    def _mean(self, values):
        found = np.zeros((len(self.corners), values.shape[1]), np.float32)
        for corners, shares in zip(self.corners.T, self.shares.T, strict=True):
            found += shares[:, None].astype(np.float32) * values.take(corners, axis=0)
        return found


# --- Expressions: what nodes compute, as (N, 4) arrays --------------------------------------------


@dataclass(frozen=True)
class Constant:
    """The same everywhere."""

    value: Sequence

    def at(self, samples):
        return np.tile(np.asarray(self.value, np.float32), (len(samples), 1))


@dataclass(frozen=True)
class ImageColor:
    """A texture where a UV map points.

    Attributes
    ----------
    texture : textures.Texture
    uv : str
        Name of the UV map.
    matrix : (2, 3) array or None
        Taken before.
    extension : str
        See `textures.sample`.
    closest : bool
    shows_alpha : bool
        Without it colors are weighted with alpha, as renderers do where nothing uses that.
    shrinks : bool
        Whether the texture may be taken at a smaller size: not where neighbors on it aren't
        neighbors on the mesh.
    """

    texture: textures.Texture
    uv: str
    matrix: np.ndarray | None = None
    extension: str = textures.REPEAT
    closest: bool = False
    shows_alpha: bool = False
    shrinks: bool = True

    def at(self, samples):
        uvs = samples.uvs(self.uv)
        if self.matrix is not None:
            uvs = uvs @ self.matrix[:, :2].T + self.matrix[:, 2]
        colors = textures.sample(self.texture, uvs, self.extension, self.closest)
        if self.shows_alpha and not self.texture.is_solid:
            colors = textures.unassociated(colors)
        return colors


@dataclass(frozen=True)
class AttributeColor:
    """A color attribute."""

    name: str

    def at(self, samples):
        return samples.colors(self.name)


@dataclass(frozen=True)
class Applied:
    """What a function makes of other expressions: it takes (N, 4) arrays and returns one.

    The name tells it from all others: equal names are equal functions.
    """

    name: str
    function: Callable
    parts: Sequence

    def at(self, samples):
        return self.function(*(part.at(samples) for part in self.parts)).astype(np.float32)


def channel(expression, number):
    """One channel of a color, as a number."""
    return Applied(f"channel {number}", lambda colors: _as_number(colors[:, number]), (expression,))


def brightness(expression):
    """A color as a number."""
    if isinstance(expression, Constant):
        return Constant([float(np.dot(expression.value[:3], _WEIGHTS))] * 3 + [1.0])
    return Applied("brightness", lambda colors: _as_number(colors[:, :3] @ _WEIGHTS), (expression,))


def _as_number(values):
    return np.column_stack([values, values, values, np.ones_like(values)])


def _mixed(blend):
    def mix(factor, first, second):
        share = factor[:, :1]
        result = first + share * (blend(first, second) - first)
        result[:, 3] = first[:, 3]
        return result

    return mix


BLENDS = {
    "MIX": _mixed(lambda a, b: b),
    "MULTIPLY": _mixed(lambda a, b: a * b),
    "ADD": _mixed(lambda a, b: a + b),
    "SUBTRACT": _mixed(lambda a, b: a - b),
    "SCREEN": _mixed(lambda a, b: 1.0 - (1.0 - a) * (1.0 - b)),
    "DARKEN": _mixed(np.minimum),
    "LIGHTEN": _mixed(np.maximum),
    "DIFFERENCE": _mixed(lambda a, b: np.abs(a - b)),
    "OVERLAY": _mixed(
        lambda a, b: np.where(a < 0.5, 2.0 * a * b, 1.0 - 2.0 * (1.0 - a) * (1.0 - b))
    ),
}
"""Of (factor, first, second), by the name that Blender has for it."""

MATHS = {
    "ADD": np.add,
    "SUBTRACT": np.subtract,
    "MULTIPLY": np.multiply,
    "MINIMUM": np.minimum,
    "MAXIMUM": np.maximum,
    "POWER": lambda a, b: np.power(np.maximum(a, 0.0), b),
}
"""Of two numbers."""


def gamma(colors, exponent):
    result = np.maximum(colors, 0.0) ** exponent[:, :1]
    result[:, 3] = colors[:, 3]
    return result


def inverted(factor, colors):
    result = colors + factor[:, :1] * (1.0 - 2.0 * colors)
    result[:, 3] = colors[:, 3]
    return result


def clamped(colors):
    return np.clip(colors, 0.0, 1.0)


def ramp(steps):
    """A function that looks a number from 0 to 1 up in (K, 4) steps."""

    def look_up(number):
        place = np.clip(number[:, 0], 0.0, 1.0) * (len(steps) - 1)
        first = np.minimum(place.astype(np.int64), len(steps) - 2)
        share = (place - first)[:, None]
        return (1.0 - share) * steps[first] + share * steps[first + 1]

    return look_up


# --- Surfaces -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Relief:
    """A normal map: its color, in the tangent space of a UV map."""

    color: object
    strength: object
    uv: str


@dataclass(frozen=True)
class Surface:
    """What a material says.

    Attributes
    ----------
    color, alpha, roughness, metallic : expressions
    relief : Relief or None
    is_lit : bool
        Whether it reflects light. What glows has the same color in any light.
    source : str
        Where the color comes from, in words; "" for none of its own.
    """

    color: object
    alpha: object = field(default_factory=lambda: Constant((1.0,) * 4))
    roughness: object = field(default_factory=lambda: Constant((0.5, 0.5, 0.5, 1.0)))
    metallic: object = field(default_factory=lambda: Constant((0.0, 0.0, 0.0, 1.0)))
    relief: Relief | None = None
    is_lit: bool = True
    source: str = ""


PLAIN = Surface(Constant((0.8, 0.8, 0.8, 1.0)))
"""Of faces without a material."""


@dataclass(frozen=True)
class Look:
    """What the faces of a mesh look like.

    Attributes
    ----------
    surfaces : tuple of Surface
    of_corners : (C,) array of int
        The surface of each corner of a face.
    uvs : dict of str to (C, 2) array
    colors : dict of str to (C, 4) array
        Color attributes, linear.
    remarks : tuple of str
        What couldn't be taken as it is, in words.
    """

    surfaces: tuple
    of_corners: np.ndarray
    uvs: dict
    colors: dict
    remarks: tuple = ()

    @property
    def sources(self):
        """Where colors come from, in words, without repeats."""
        used = np.unique(self.of_corners)
        found = [self.surfaces[number].source for number in used.tolist()]
        return [source for source in dict.fromkeys(found) if source]

    def used(self):
        """The surfaces that faces have."""
        return [self.surfaces[number] for number in np.unique(self.of_corners).tolist()]

    def values(self, what, corners, shares):
        """(N, 4): what the surfaces say at places.

        Parameters
        ----------
        what : function
            From a Surface to an expression.
        corners, shares : (N, K) arrays
            The corners of a face around each place, and their shares.
        """
        if len(self.surfaces) == 1:
            return what(self.surfaces[0]).at(Samples(self, corners, shares))
        result = np.empty((len(corners), 4), np.float32)
        numbers = self.of_corners[corners[:, 0]]
        for number in np.flatnonzero(np.bincount(numbers)).tolist():
            rows = np.flatnonzero(numbers == number)
            samples = Samples(self, corners[rows], shares[rows])
            result[rows] = what(self.surfaces[number]).at(samples)
        return result

    def color_values(self, corners, shares):
        """(N, 4): color and alpha at places."""
        result = self.values(lambda surface: surface.color, corners, shares)
        alphas = {
            surface.alpha.value[0] if isinstance(surface.alpha, Constant) else None
            for surface in self.surfaces
        }
        if len(alphas) == 1 and None not in alphas:
            result[:, 3] = alphas.pop()
        else:
            result[:, 3] = self.values(lambda surface: surface.alpha, corners, shares)[:, 0]
        return result

    def corner_colors(self):
        """(C, 4): color and alpha of every corner."""
        corners = np.arange(len(self.of_corners))[:, None]
        return self.color_values(corners, np.ones((len(corners), 1), np.float32))


def described(expression):
    """An expression in words, the same for the same."""
    if isinstance(expression, Constant):
        return " ".join(f"{value:.5g}" for value in expression.value)
    if isinstance(expression, AttributeColor):
        return expression.name
    if isinstance(expression, ImageColor):
        matrix = None if expression.matrix is None else expression.matrix.round(6).tolist()
        rest = expression.uv, matrix, expression.extension, expression.closest
        return f"{expression.texture.name} {rest}"
    parts = ", ".join(described(part) for part in expression.parts)
    return f"{expression.name}({parts})"


def reduced(expression, texels):
    """An expression whose textures are as coarse as samples of it lie apart.

    Parameters
    ----------
    texels : function
        From an ImageColor to the number of its pixels from one sample to the next.
    """
    if isinstance(expression, Applied):
        return replace(expression, parts=[reduced(part, texels) for part in expression.parts])
    if isinstance(expression, ImageColor) and expression.shrinks and not expression.closest:
        times = int(np.floor(np.log2(max(texels(expression), 1.0)) + 0.3))
        return replace(expression, texture=expression.texture.reduced(times))
    return expression


def constant_of(look, what):
    """The value that all surfaces in use have, or None."""
    values = [what(surface) for surface in look.used()]
    if not all(isinstance(value, Constant) for value in values):
        return None
    found = {tuple(float(x) for x in value.value) for value in values}
    return found.pop() if len(found) == 1 else None
