"""What sockets are worth: numbers, pictures, or colors of vertices."""

from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class Place:
    """Where a picture lies on a mesh: a map of texture coordinates and an affine map of it."""

    uv: str = ""  # the map to render with
    rows: tuple = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))

    def is_plain(self):
        return self.rows == Place.rows

    def apply(self, uvs):
        """Moves (n, 2) coordinates."""
        rows = np.array(self.rows)
        return (uvs @ rows[:, :2].T + rows[:, 2]).astype(np.float32)

    def after(self, rows):
        """The same, moved once more by a map of 2 by 3."""
        first, second = (np.vstack([r, [0, 0, 1]]) for r in (np.array(self.rows), np.array(rows)))
        product = (second @ first)[:2]
        return replace(self, rows=tuple(tuple(float(x) for x in row) for row in product))


@dataclass(frozen=True, eq=False)
class Picture:
    """Linear pixels of shape (height, width) or (height, width, 3), first row on top."""

    pixels: np.ndarray
    place: Place
    wrap: str = "repeat"
    nearest: bool = False
    # The image of which these are the color or the alpha, as it is.
    image: object = field(default=None, compare=False)

    def mean(self):
        return self.pixels.reshape(-1, *self.pixels.shape[2:]).mean(axis=0, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class VertexColor:
    """A color attribute times a constant color."""

    name: str
    factor: np.ndarray

    def mean(self):
        return 0.5 * self.factor


def is_constant(value):
    return not isinstance(value, (Picture, VertexColor))


def mean(value):
    """A constant in place of whatever it is."""
    return np.asarray(value, np.float64) if is_constant(value) else np.asarray(value.mean(), np.float64)


def gray(value):
    """A number in place of a color, as Blender converts it."""
    weights = np.array([0.2126, 0.7152, 0.0722])
    if isinstance(value, Picture):
        return value if value.pixels.ndim == 2 else replace(value, pixels=value.pixels @ weights, image=None)
    constant = mean(value)
    return constant if constant.ndim == 0 else constant @ weights


def color(value):
    """A color in place of a number."""
    if isinstance(value, VertexColor):
        return value
    if isinstance(value, Picture):
        if value.pixels.ndim == 3:
            return value
        return replace(value, pixels=np.repeat(value.pixels[:, :, None], 3, axis=2), image=None)
    constant = np.asarray(value, np.float64)
    return np.repeat(constant, 3) if constant.ndim == 0 else constant


def combine(function, values, remark):
    """`function` of arrays that broadcast in the last axis: of constants, or pixel by pixel of pictures at one place.

    `remark` is told where that cannot be done, and means stand for what varies."""
    pictures = [value for value in values if isinstance(value, Picture)]
    if any(isinstance(value, VertexColor) for value in values):
        scaled = _scaled_attribute(function, values)
        if scaled is not None:
            return scaled
        remark("computes with a color attribute; took its middle")
        values = [value.mean() if isinstance(value, VertexColor) else value for value in values]
    if not pictures:
        return function(*(mean(value) for value in values))
    first = max(pictures, key=lambda picture: picture.pixels.shape[0] * picture.pixels.shape[1])
    same = [p for p in pictures if (p.place, p.wrap) == (first.place, first.wrap)]
    if len(same) < len(pictures):
        remark("combines pictures at different places; took the mean of one")
    wide = any(np.ndim(v.pixels) == 3 if isinstance(v, Picture) else np.ndim(mean(v)) == 1 for v in values)
    kept = {id(picture) for picture in same}
    arrays = [_pixels(value, first, wide) if id(value) in kept else mean(value) for value in values]
    result = np.asarray(function(*arrays))
    if result.ndim < 2:
        return result
    if result.ndim == 3 and result.shape[2] == 1:
        result = result[:, :, 0]
    return replace(first, pixels=result, image=None)


def _scaled_attribute(function, values):
    """Where the function multiplies an attribute with a constant, the attribute with that factor."""
    attributes = [value for value in values if isinstance(value, VertexColor)]
    if len(attributes) != 1 or any(isinstance(value, Picture) for value in values):
        return None

    def at(number):
        return np.asarray(function(*(np.full(3, number) if v is attributes[0] else mean(v) for v in values)))

    low, middle, high = at(0.0), at(0.5), at(1.0)
    if high.shape == (3,) and np.allclose(low, 0) and np.allclose(middle, 0.5 * high):
        return replace(attributes[0], factor=attributes[0].factor * high)
    return None


def _pixels(picture, like, wide):
    pixels = picture.pixels
    height, width = like.pixels.shape[:2]
    if pixels.shape[:2] != (height, width):
        rows = np.arange(height) * pixels.shape[0] // height
        columns = np.arange(width) * pixels.shape[1] // width
        pixels = pixels[rows][:, columns]
    return pixels[:, :, None] if wide and pixels.ndim == 2 else pixels
