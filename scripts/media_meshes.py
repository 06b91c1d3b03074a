#!/usr/bin/env python3
"""Writes the meshes of scenes/media: a goblet, the liquid in it, and a pool of water with waves.

usage: media_meshes.py [FOLDER]
"""

import math
import sys
from pathlib import Path

STEPS = 48  # around the axis
LEVEL = 2.1  # of the liquid, at the middle of the bowl
OUTER, INNER = (0.8, 0.9), (0.76, 0.86)  # half axes of the bowl: radius and height


def bowl(axes, start, end, count):
    """Points (radius, height) of an ellipse around the middle of the bowl, at angles from its lowest point."""
    angles = [start + (end - start) * i / count for i in range(count + 1)]
    return [(axes[0] * math.sin(a), LEVEL - axes[1] * math.cos(a)) for a in angles]


def turned(run):
    """Vertices, normals and triangles of a profile that is smooth, around the z axis; fronts are on its right."""
    lines, last = [], len(run) - 1
    for i, (r, z) in enumerate(run):
        (r0, z0), (r1, z1) = run[max(i - 1, 0)], run[min(i + 1, last)]
        length = math.hypot(r1 - r0, z1 - z0)
        out, up = (z1 - z0) / length, -(r1 - r0) / length
        if r == 0:
            out, up = 0.0, math.copysign(1.0, up)
        for step in range(STEPS):
            x, y = math.cos(math.tau * step / STEPS), math.sin(math.tau * step / STEPS)
            lines.append(((r * x, r * y, z), (out * x, out * y, up)))
    faces = []
    for i in range(last):
        for step in range(STEPS):
            following = (step + 1) % STEPS
            a, b = i * STEPS + step, i * STEPS + following
            c, d = b + STEPS, a + STEPS
            if run[i][0] > 0:
                faces.append((a, b, c))
            if run[i + 1][0] > 0:
                faces.append((a, c, d))
    return lines, faces


def flat(corners, faces):
    """Triangles with the normals of their planes."""
    lines, own = [], []
    for face in faces:
        a, b, c = (corners[i] for i in face)
        u, v = [b[i] - a[i] for i in range(3)], [c[i] - a[i] for i in range(3)]
        n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        length = math.hypot(*n)
        own.append(tuple(range(len(lines), len(lines) + 3)))
        lines += [(corner, [x / length for x in n]) for corner in (a, b, c)]
    return lines, own


def waves(half, depth, count):
    """A box of water below z = 0 whose top has waves, and the sides and floor of it."""

    def height(x, y):
        """Height of the water, and its slopes."""
        z = dx = dy = 0.0
        for kx, ky, size, phase in ((5.0, 0.5, 0.06, 0.3), (-3.1, 1.1, 0.05, 1.1), (7.3, 1.6, 0.015, 2.0)):
            angle = kx * x + ky * y + phase
            z += size * math.sin(angle)
            dx += kx * size * math.cos(angle)
            dy += ky * size * math.cos(angle)
        return z, dx, dy

    at = [half * (2 * i / count - 1) for i in range(count + 1)]
    top = []
    for y in at:
        for x in at:
            z, dx, dy = height(x, y)
            length = math.sqrt(dx * dx + dy * dy + 1)
            top.append(((x, y, z), (-dx / length, -dy / length, 1 / length)))
    row, faces = count + 1, []
    for j in range(count):
        for i in range(count):
            a = j * row + i
            faces += [(a, a + 1, a + row + 1), (a, a + row + 1, a + row)]
    edge = [i for i in range(row)] + [j * row + count for j in range(1, row)]
    edge += [count * row + i for i in reversed(range(count))] + [j * row for j in reversed(range(1, count))]
    rim = [top[i][0] for i in edge]
    low = [(x, y, -depth) for x, y, _ in rim]
    n, sides = len(rim), []
    for i in range(n):
        k = (i + 1) % n
        sides += [(n + i, n + k, k), (n + i, k, i)]
    corners = rim + low + [(0.0, 0.0, -depth)]
    sides += [(2 * n, n + (i + 1) % n, n + i) for i in range(n)]
    return [(top, faces), flat(corners, sides)]


def write(path, parts):
    places, normals, faces, first = [], [], [], 1
    for lines, own in parts:
        places += ["v " + " ".join(f"{x + 0:.5g}" for x in place) for place, _ in lines]
        normals += ["vn " + " ".join(f"{x + 0:.4g}" for x in normal) for _, normal in lines]
        faces += ["f " + " ".join(f"{first + i}//{first + i}" for i in face) for face in own]
        first += len(lines)
    path.write_text("\n".join(places + normals + faces) + "\n")


def main():
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).resolve().parent.parent / "scenes/media")
    rim = 2.2
    (r0, z0), (r1, z1) = bowl(OUTER, rim, rim, 1)[0], bowl(INNER, rim, rim, 1)[0]
    foot = [(0.75, 0.0), (0.75, 0.05)]
    stem = [(0.75, 0.05), (0.4, 0.09), (0.15, 0.2), (0.08, 0.4), (0.08, 0.8), (0.1, 1.05), *bowl(OUTER, 0.25, rim, 14)]
    outside = [[(0.0, 0.0), (0.75, 0.0)], foot, stem, [(r0, z0), (r1, z1)]]
    inside = list(reversed(bowl(INNER, math.pi / 2, rim, 6)))
    write(folder / "goblet.obj", [turned(run) for run in [*outside, inside]])
    # The liquid wets the bowl below its level. Fronts of its surface are outside.
    write(folder / "liquid-glass.obj", [turned(bowl(INNER, 0, math.pi / 2, 10))])
    write(folder / "liquid-air.obj", [turned([(INNER[0], LEVEL), (0.0, LEVEL)])])
    write(folder / "water.obj", waves(2.1, 2.1, 40))


main()
