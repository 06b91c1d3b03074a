"""A sphere of triangles."""

import functools
import math

import numpy as np

SUBDIVISIONS = 2


@functools.lru_cache(maxsize=1)
def icosphere():
    """Triangles and positions of a sphere of the unit sphere's area, and so of its mean shadow."""
    golden = (1 + math.sqrt(5)) / 2
    corners = [(-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0)]
    positions = [corner[-k:] + corner[:-k] for k in range(3) for corner in corners]
    positions = np.array(positions, np.float64)
    positions /= np.linalg.norm(positions[0])
    triangles = _hull(positions)
    for _ in range(SUBDIVISIONS):
        triangles, positions = _divided(triangles, positions)
    # By Cauchy's formula a convex body's mean shadow is a quarter of its area.
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    positions = positions * math.sqrt(4 * math.pi / area)
    return triangles, positions


def _hull(positions):
    """Of an icosahedron: corners at the least distance make its triangles, counterclockwise from outside."""
    distance = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    least = distance[distance > 1e-9].min() * 1.01
    near = (distance > 1e-9) & (distance < least)
    found = []
    for a in range(12):
        for b in range(a + 1, 12):
            for c in range(b + 1, 12):
                if near[a, b] and near[b, c] and near[a, c]:
                    inside = (
                        np.dot(np.cross(positions[b] - positions[a], positions[c] - positions[a]), positions[a]) < 0
                    )
                    found.append((a, c, b) if inside else (a, b, c))
    return np.array(found)


def _divided(triangles, positions):
    """Each triangle by four, with the new corners on the unit sphere."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    pairs, index = np.unique(edges, axis=0, return_inverse=True)
    middle = positions[pairs].sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    (ab, bc, ca) = (index.reshape(-1, 3) + len(positions)).T
    a, b, c = triangles.T
    triangles = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return triangles, np.concatenate([positions, middle])
