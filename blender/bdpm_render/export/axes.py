"""From Blender's axes, z up, to those of bdpm's scenes, y up: (x, y, z) becomes (x, z, -y)."""

import numpy as np

TO_SCENE = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def matrix(blender):
    """A matrix from an object's space to the scene's, 4 by 4."""
    return TO_SCENE @ np.array(blender, np.float64)


def vector(blender):
    x, y, z = blender
    return (float(x), float(z), -float(y))


def from_scene(xyz):
    """Vectors of the scene, in the last axis, as Blender's."""
    return np.stack([xyz[..., 0], -xyz[..., 2], xyz[..., 1]], axis=-1)
