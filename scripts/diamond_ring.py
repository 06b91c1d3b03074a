#!/usr/bin/env python3
"""Writes the meshes of scenes/diamond-ring.

    scripts/diamond_ring.py [FOLDER]    default: scenes

Needs numpy. Lengths are centimeters; y is up.
"""

import sys
from pathlib import Path

import numpy as np


def polygons_of(planes):
    """Faces of the body {x: n.x <= d for all planes}, counterclockwise seen from outside."""
    faces = []
    for index, (normal, distance) in enumerate(planes):
        u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        u /= np.linalg.norm(u)
        v = np.cross(normal, u)
        face = [distance * normal + 10 * (a * u + b * v) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        for other, (n, d) in enumerate(planes):
            if other != index:
                face = clip(face, n, d)
        if len(face) >= 3:
            faces.append(face)
    return faces


def clip(face, normal, distance):
    """The part of a polygon with `normal.x <= distance`."""
    kept = []
    for a, b in zip(face, face[1:] + face[:1], strict=True):
        at_a, at_b = normal @ a - distance, normal @ b - distance
        if at_a <= 0:
            kept.append(a)
        if at_a * at_b < 0:
            kept.append(a + (b - a) * (at_a / (at_a - at_b)))
    return kept


def brilliant():
    """Facets of a round brilliant with a girdle of radius 1; the table looks along +y.

    Crown 34.5 degrees, pavilion 40.75 degrees, table 56 %: close to Tolkowsky's proportions (1919).
    """
    planes = []

    def facets(count, first, angle, radius, height):
        """Facets at this angle from the horizontal, negative below the girdle, through a point."""
        for k in range(count):
            turn = np.radians(first + 360 / count * k)
            around = np.array([np.cos(turn), 0, np.sin(turn)])
            slope = np.radians(abs(angle))
            normal = np.sin(slope) * around + np.sign(angle) * np.cos(slope) * np.array([0.0, 1, 0])
            planes.append((normal, normal @ (radius * around + [0, height, 0])))

    girdle, table = 0.02, 0.56
    top = girdle + np.tan(np.radians(34.5)) * (1 - table)
    planes.append((np.array([0.0, 1, 0]), top))
    facets(8, 0, 34.5, 1, girdle)  # crown mains
    facets(8, 22.5, 22, table + 0.035, top)  # stars
    facets(16, 11.25, 39.5, 1, girdle + 0.012)  # upper halves
    facets(8, 0, -40.75, 1, -girdle)  # pavilion mains
    facets(16, 11.25, -41.9, 1, -girdle - 0.008)  # lower halves
    facets(64, 0, 90, 1, 0)  # girdle
    return polygons_of(planes)


def moved(faces, matrix, offset):
    return [[matrix @ np.asarray(p) + offset for p in face] for face in faces]


def on_pavilion(faces, turn):
    """The stone lying on one of its pavilion mains, turned about y, on y = 0."""
    slope = np.radians(40.75)
    down = np.array([np.sin(slope), -np.cos(slope), 0])
    target = np.array([0.0, -1, 0])
    axis, cos = np.cross(down, target), down @ target
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    lean = np.eye(3) + k + k @ k / (1 + cos)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    faces = moved(faces, np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ lean, np.zeros(3))
    low = min(p[1] for face in faces for p in face)
    return moved(faces, np.eye(3), np.array([0, -low, 0]))


def square(center, target, half):
    """A square of side 2 `half` whose front looks at `target`."""
    center = np.array(center, float)
    normal = np.array(target, float) - center
    normal /= np.linalg.norm(normal)
    u = np.cross(normal, [0, 1, 0.01])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    return [[center + half * (a * u + b * v) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]]


def band(radius, thick, wide, around, across, center):
    """A ring about the z axis with an elliptic section: positions, normals and quads."""
    positions, normals, quads = [], [], []
    for i in range(around):
        c, s = np.cos(2 * np.pi * i / around), np.sin(2 * np.pi * i / around)
        for j in range(across):
            turn = 2 * np.pi * j / across
            r = radius + thick * np.cos(turn)
            positions.append(np.array([r * c, r * s, wide * np.sin(turn)]) + center)
            n = np.array([np.cos(turn) / thick, np.sin(turn) / wide])
            n /= np.linalg.norm(n)
            normals.append(np.array([n[0] * c, n[0] * s, n[1]]))
            at = lambda a, b: a % around * across + b % across  # noqa: E731
            quads.append([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
    return positions, normals, quads


def rod(start, end, radius, around, rounds):
    """A rod with a round end at `end` and no cap at `start`: positions, normals and faces."""
    start, end = np.array(start, float), np.array(end, float)
    w = (end - start) / np.linalg.norm(end - start)
    u = np.cross(w, [0.3, 0.5, 0.81])
    u /= np.linalg.norm(u)
    v = np.cross(w, u)
    positions, normals, faces = [], [], []
    rows = [(start, 0.0)] + [(end, np.pi / 2 * k / rounds) for k in range(rounds)]
    for center, lift in rows:
        for i in range(around):
            turn = 2 * np.pi * i / around
            n = np.cos(lift) * (np.cos(turn) * u + np.sin(turn) * v) + np.sin(lift) * w
            positions.append(center + radius * n)
            normals.append(n)
    positions.append(end + radius * w)
    normals.append(w)
    for row in range(len(rows) - 1):
        for i in range(around):
            j = (i + 1) % around
            faces.append([row * around + i, row * around + j, (row + 1) * around + j, (row + 1) * around + i])
    last = (len(rows) - 1) * around
    faces += [[last + i, last + (i + 1) % around, len(positions) - 1] for i in range(around)]
    return positions, normals, faces


def number(x, decimals):
    text = f"{x:.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def write_flat(path, comment, material, faces):
    lines, places = [f"# {comment}", f"usemtl {material}"], {}
    body = []
    for face in faces:
        keys = [tuple(number(x, 6) for x in p) for p in face]
        indices = [places.setdefault(key, len(places) + 1) for key in keys]
        indices = [a for a, b in zip(indices, indices[1:] + indices[:1], strict=True) if a != b]
        if len(set(indices)) >= 3:
            body.append("f " + " ".join(map(str, indices)))
    lines += ["v " + " ".join(key) for key in places]
    path.write_text("\n".join(lines + body) + "\n")


def write_smooth(path, comment, material, parts):
    lines, first = [f"# {comment}", f"usemtl {material}"], 1
    for positions, normals, faces in parts:
        lines += ["v " + " ".join(number(x, 4) for x in p) for p in positions]
        lines += ["vn " + " ".join(number(x, 4) for x in n) for n in normals]
        lines += ["f " + " ".join(f"{first + i}//{first + i}" for i in face) for face in faces]
        first += len(positions)
    path.write_text("\n".join(lines) + "\n")


def ring(folder):
    stone = brilliant()
    radius, thick, wide = 0.98, 0.06, 0.13
    center = np.array([0, radius + thick - 0.01, 0])
    top = center[1] + radius
    girdle = top + 0.36
    write_smooth(folder / "band.obj", "A ring that stands on the table.", "gold",
                 [band(radius, thick, wide, 96, 24, center)])
    prongs = []
    for k in range(6):
        turn = np.pi / 6 + k * np.pi / 3
        around = np.array([np.cos(turn), 0, np.sin(turn)])
        foot, bend = 0.1 * around + [0, top + 0.02, 0], 0.535 * around + [0, girdle - 0.02, 0]
        tip = 0.5 * around + [0, girdle + 0.055, 0]
        prongs += [rod(foot, bend, 0.035, 16, 4), rod(bend, tip, 0.035, 16, 4)]
    write_smooth(folder / "prongs.obj", "Six prongs that hold the stone.", "gold", prongs)
    write_flat(folder / "stone.obj", "A round brilliant on the ring.", "diamond",
               moved(stone, 0.5 * np.eye(3), np.array([0, girdle, 0])))
    loose = moved(on_pavilion(stone, 200), 0.42 * np.eye(3), np.array([1.35, 0.001, 0.75]))
    write_flat(folder / "loose.obj", "A round brilliant that lies on the table.", "diamond", loose)
    table = [[np.array(p, float) for p in ((-14, 0, 14), (14, 0, 14), (14, 0, -14), (-14, 0, -14))]]
    write_flat(folder / "table.obj", "The table.", "table", table)
    lamps = square((-5, 7, -3.5), (0.4, 1, 0.2), 0.16) + square((6.5, 8, -1.5), (0.4, 1, 0.2), 0.16)
    write_flat(folder / "lamps.obj", "Two small lamps.", "lamp", lamps)
    write_flat(folder / "soft.obj", "A soft light.", "soft", square((-2, 10, 6), (0, 0, 0), 2.5))


def main():
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "scenes")
    ring(folder / "diamond-ring")


if __name__ == "__main__":
    main()
