#!/usr/bin/env python3
"""The analytical cases of CIE 171:2006 by `bdpm measure`, beside closed forms and quadrature, as Markdown tables.

    scripts/cie171.py                  # all cases, 20 minutes on 2 cores
    scripts/cie171.py 5.2 5.8          # some of them
    scripts/cie171.py --seconds 5 --skies 1,12 5.11

Wants numpy. Each case is a scene that this script writes, with meters at the points of the publication. Its tables are
not used: errata are known in some, and references here are computed from the geometry alone, to a relative error below
1e-4. Columns:

- *points*: meters, over all variants of the case;
- *within*: those whose interval of 95 % holds the reference;
- *unknown*: those of which the program says that too few paths saw light;
- *largest z*: the largest distance from the reference, in half-widths of the interval;
- *largest deviation*: of points with at least a hundredth of the largest reading of their variant, and the half-width
  of the interval of that point;
- *mean*: sum of the readings over that of the references.

Exit code 1 if fewer than 9 of 10 intervals of a case hold, or a reading is further than two half-widths from the
reference and off by more than 1 %. The program is target/release/bdpm, or the one that the environment variable BDPM
names.
"""

import argparse
import itertools
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
BDPM = os.environ.get("BDPM", ROOT / "target/release/bdpm")
# Lumens per watt of white light, as docs/reference/scene-format.md defines it.
EFFICACY = 683.0
# Illuminance of the horizontal by the sky, lx.
OUTDOORS = 10_000.0
GROUND = 0.30
GLASS = 1.52
# Toward the sun of the skies that have one: 60 degrees high in the south, which is -z.
SUN = np.array([0.0, math.sin(math.radians(60)), -math.cos(math.radians(60))])
# Room of 4 m by 4 m and 3 m high; y is up. Facades are the wall at z = 0.
WIDTH, DEPTH, HEIGHT = 4.0, 4.0, 3.0
UP, DOWN, SOUTH, NORTH = (0, 1, 0), (0, -1, 0), (0, 0, -1), (0, 0, 1)
HEIGHTS = [2.75, 2.25, 1.75, 1.25, 0.75, 0.25]
DEPTHS = [0.25 + 0.5 * step for step in range(8)]
# a, b, c, d, e of the CIE general sky (ISO 15469:2004, table 1).
SKIES = [
    (4.0, -0.70, 0.0, -1.0, 0.0),
    (4.0, -0.70, 2.0, -1.5, 0.15),
    (1.1, -0.80, 0.0, -1.0, 0.0),
    (1.1, -0.80, 2.0, -1.5, 0.15),
    (0.0, -1.0, 0.0, -1.0, 0.0),
    (0.0, -1.0, 2.0, -1.5, 0.15),
    (0.0, -1.0, 5.0, -2.5, 0.30),
    (0.0, -1.0, 10.0, -3.0, 0.45),
    (-1.0, -0.55, 2.0, -1.5, 0.15),
    (-1.0, -0.55, 5.0, -2.5, 0.30),
    (-1.0, -0.55, 10.0, -3.0, 0.45),
    (-1.0, -0.32, 10.0, -3.0, 0.45),
    (-1.0, -0.32, 16.0, -3.0, 0.30),
    (-1.0, -0.15, 16.0, -3.0, 0.30),
    (-1.0, -0.15, 24.0, -2.8, 0.15),
]


# Scenes


def quad(material, corner, u, v):
    """A parallelogram whose front sees the side of the cross product."""
    corner, u, v = (np.array(vector, float) for vector in (corner, u, v))
    return material, [corner, corner + u, corner + u + v, corner + v]


def box(low, high, material):
    """The outside of a box."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    x, y, z = x1 - x0, y1 - y0, z1 - z0
    return [
        quad(material, (x0, y0, z0), (x, 0, 0), (0, 0, z)),
        quad(material, (x0, y1, z0), (0, 0, z), (x, 0, 0)),
        quad(material, (x0, y0, z0), (0, 0, z), (0, y, 0)),
        quad(material, (x1, y0, z0), (0, y, 0), (0, 0, z)),
        quad(material, (x0, y0, z0), (0, y, 0), (x, 0, 0)),
        quad(material, (x0, y0, z1), (x, 0, 0), (0, y, 0)),
    ]


def around(opening, size, place):
    """The parts of a rectangle of this size outside of its opening (low and high corner), by their corner and size."""
    (u0, v0), (u1, v1) = opening
    u, v = size
    parts = [(0, 0, u, v0), (0, v1, u, v - v1), (0, v0, u0, v1 - v0), (u1, v0, u - u1, v1 - v0)]
    return [place(*part) for part in parts if part[2] > 1e-9 and part[3] > 1e-9]


def room(roof=None, facade=None, height=HEIGHT, material="black"):
    """A room of 4 m by 4 m, with an opening in its roof or its facade."""
    x, y, z = WIDTH, height, DEPTH
    quads = [
        quad(material, (0, 0, 0), (0, 0, z), (x, 0, 0)),
        quad(material, (0, 0, z), (0, y, 0), (x, 0, 0)),
        quad(material, (0, 0, 0), (0, y, 0), (0, 0, z)),
        quad(material, (x, 0, 0), (0, 0, z), (0, y, 0)),
    ]
    quads += around(roof or [(0, 0), (0, 0)], (x, z), lambda u, v, a, b: quad(material, (u, y, v), (a, 0, 0), (0, 0, b)))
    quads += around(facade or [(0, 0), (0, 0)], (x, y), lambda u, v, a, b: quad(material, (u, v, 0), (a, 0, 0), (0, b, 0)))
    return quads


MATERIALS = {
    "black": "albedo = 0.0",
    "glass": f'type = "thin-dielectric"\nior = {GLASS}',
}
CAMERA = "[camera]\nposition = [2, 1.5, 2]\ntarget = [2, 1.5, 3]\nfov_x_deg = 60\n"


def measure(quads, light, meters, seconds, materials=None, options=()):
    """Readings of single meters, a position and a normal each, or of a grid, as pairs of value and half-width, lx."""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        lines, count = [], 0
        for material, corners in quads:
            lines += ["v {:.9g} {:.9g} {:.9g}".format(*corner) for corner in corners]
            lines += [f"usemtl {material}", "f " + " ".join(str(count + i) for i in (1, 2, 3, 4))]
            count += 4
        if not quads:
            # A scene has a surface; this one is far away and sees nothing.
            lines = ["v 0 -900 0", "v 1 -900 0", "v 0 -900 1", "usemtl black", "f 1 2 3"]
        (folder / "room.obj").write_text("\n".join(lines) + "\n")
        text = CAMERA + '[[mesh]]\nfile = "room.obj"\n' + light + "\n"
        used = {material for material, _ in quads} | {"black"}
        for name, keys in (MATERIALS | (materials or {})).items():
            if name in used:
                text += f"[materials.{name}]\n{keys}\n"
        for index, meter in enumerate(meters):
            text += f'[[meter]]\nname = "{index}"\n'
            if isinstance(meter, str):
                text += meter
            else:
                position, normal = meter
                text += f"position = {[float(x) for x in position]}\nnormal = {[float(x) for x in normal]}\n"
        (folder / "scene.toml").write_text(text)
        command = [BDPM, "measure", folder / "scene.toml", "--time", f"{seconds:g}s", "--json", "--quiet", *options]
        run = subprocess.run([str(part) for part in command], capture_output=True, text=True)
        if run.returncode not in (0, 3):
            sys.exit(f"{run.stderr}\n{text}")
        return json.loads(run.stdout)["meters"]


def single(reports):
    """Values and half-widths of single meters."""
    readings = [report["readings"][0] for report in reports]
    unknown = lambda number: math.nan if number is None else number
    return [(unknown(own["value"]), unknown(own["expanded"])) for own in readings]


# References


def legendre(low, high, panels):
    """Nodes and weights on an interval, Gauss-Legendre with 8 points in each panel. Panels are finer at both ends."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    edges = low + (high - low) * 0.5 * (1 - np.cos(np.linspace(0, math.pi, panels + 1)))
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * (edges[1:] - edges[:-1])
    return (middle[:, None] + half[:, None] * nodes).ravel(), (half[:, None] * weights).ravel()


def through(point, normal, corner, u, v, radiance, breaks=((), ()), panels=24):
    """Illuminance of a point through a rectangle, or by it, from the luminance toward each direction.

    `breaks` are the places along both sides, from 0 to 1, where the luminance jumps.
    """
    point, normal, corner, u, v = (np.array(own, float) for own in (point, normal, corner, u, v))
    facing = np.cross(u, v)
    total = 0.0
    pieces = [sorted({0.0, 1.0, *(place for place in places if 0 < place < 1)}) for places in breaks]
    for (a0, a1), (b0, b1) in itertools.product(*(zip(own, own[1:]) for own in pieces)):
        a, wa = legendre(a0, a1, panels)
        b, wb = legendre(b0, b1, panels)
        to = corner + a[:, None, None] * u + b[None, :, None] * v - point
        squared = (to**2).sum(-1)
        toward = to / np.sqrt(squared)[..., None]
        cosine = np.clip(toward @ normal, 0, None)
        area = np.abs(toward @ facing)
        total += float((wa[:, None] * wb[None, :] * radiance(toward) * cosine * area / squared).sum())
    return total


def sky(kind):
    """The luminance of a sky toward directions, cd/m^2, and below the horizon that of the ground."""
    a, b, c, d, e = SKIES[kind - 1]

    def relative(toward):
        height = np.clip(toward[..., 1], 1e-9, None)
        angle = np.arccos(np.clip(toward @ SUN, -1, 1))
        gradation = 1 + a * np.exp(b / height)
        return gradation * (1 + c * (np.exp(d * angle) - math.exp(0.5 * d * math.pi)) + e * np.cos(angle) ** 2)

    # The measure of the squared cosine is that of the projected solid angle.
    s, ws = legendre(0, 1, 48)
    phi, wphi = legendre(0, 2 * math.pi, 48)
    up, across = np.sqrt(s)[:, None], np.sqrt(1 - s)[:, None]
    dome = np.stack([across * np.cos(phi), up + 0 * phi, across * np.sin(phi)], -1)
    scale = OUTDOORS / (0.5 * float((ws[:, None] * wphi * relative(dome)).sum()))
    return lambda toward: np.where(toward[..., 1] > 0, scale * relative(toward), GROUND * OUTDOORS / math.pi)


def sky_keys(kind):
    return (
        f'[sky]\nmodel = "cie"\ncie_type = {kind}\ndiffuse_lx = {OUTDOORS}\nalbedo = {GROUND}\n'
        f"sun_direction = {[float(x) for x in SUN]}\n"
    )


def pane(cosine):
    """Transmittance of a clear sheet of glass with all reflections, mean of both polarizations."""
    cosine = np.clip(np.abs(cosine), 1e-9, 1)
    inside = np.sqrt(1 - (1 - cosine**2) / GLASS**2)
    s = ((cosine - GLASS * inside) / (cosine + GLASS * inside)) ** 2
    p = ((GLASS * cosine - inside) / (GLASS * cosine + inside)) ** 2
    return 0.5 * ((1 - s) / (1 + s) + (1 - p) / (1 + p))


def behind_pane(radiance, axis):
    return lambda toward: radiance(toward) * pane(toward[..., axis])


# Cases. Each yields a name of its variant, readings and references.


def point_sources(own):
    places = [(0, 0), (0.5, 0), (1, 0), (1.5, 0), (0.5, 0.5), (1, 0.5), (1.5, 0.5), (1, 1), (1.5, 1), (1.5, 1.5)]
    meters = [((x, 0, z), UP) for x, z in places]
    floor = [quad("black", (-2, 0, -2), (0, 0, 4), (4, 0, 0))]
    distance = [math.sqrt(x * x + z * z + 9) for x, z in places]
    light = '[[light]]\ntype = "point"\nposition = [0, 3, 0]\ncandela = 1000\n'
    reports = measure(floor, light, meters, own.seconds)
    yield "isotropic, 1000 cd", single(reports), [1000 * 3 / d**3 for d in distance]
    with tempfile.TemporaryDirectory() as folder:
        angles = np.arange(0, 91, 1.0)
        candela = " ".join(f"{1000 * max(math.cos(math.radians(a)), 0):.6f}" for a in angles)
        lines = ["IESNA:LM-63-2002", "[TEST] cosine", "TILT=NONE", f"1 -1 1 {len(angles)} 1 1 2 0 0 0", "1 1 0"]
        lines += [" ".join(f"{a:g}" for a in angles), "0", candela]
        file = Path(folder) / "cosine.ies"
        file.write_text("\n".join(lines) + "\n")
        light = f'[[light]]\ntype = "luminaire"\nfile = "{file}"\nposition = [0, 3, 0]\nopening = "point"\n'
        reports = measure(floor, light, meters, own.seconds)
    yield "cosine, 1000 cd, from an IES file", single(reports), [1000 * 9 / d**4 for d in distance]


def area_source(own):
    lamp = {"lamp": f"albedo = 0.0\nemission = {1000 / EFFICACY}"}
    corner, u, v = (1.5, 2.999, 1.5), (1, 0, 0), (0, 0, 1)
    meters = [((2, y, 0), NORTH) for y in HEIGHTS] + [((2, 0, z), UP) for z in DEPTHS]
    reports = measure(room() + [quad("lamp", corner, u, v)], "", meters, own.seconds, lamp)
    luminance = lambda toward: 1000 + 0 * toward[..., 0]
    yield "1000 cd/m2", single(reports), [through(*meter, corner, u, v, luminance) for meter in meters]


def flux(own):
    """Means over all faces times their areas, and the flux of the source."""
    light = '[[light]]\ntype = "point"\nposition = [2, 1.5, 2]\nlumen = 10000\n'
    faces = [
        ((0, 0, 0), (4, 0, 0), (0, 0, 4), UP),
        ((0, 3, 0), (4, 0, 0), (0, 0, 4), DOWN),
        ((0, 0, 0), (4, 0, 0), (0, 3, 0), NORTH),
        ((0, 0, 4), (4, 0, 0), (0, 3, 0), SOUTH),
        ((0, 0, 0), (0, 0, 4), (0, 3, 0), (1, 0, 0)),
        ((4, 0, 0), (0, 0, 4), (0, 3, 0), (-1, 0, 0)),
    ]
    grids = []
    for corner, u, v, normal in faces:
        keys = f"corner = {list(map(float, corner))}\nedges = [{list(map(float, u))}, {list(map(float, v))}]\n"
        grids.append(keys + f"columns = 40\nrows = 40\nnormal = {list(map(float, normal))}\n")
    reports = measure(room(), light, grids, own.seconds, options=["--mean"])
    areas = [np.linalg.norm(u) * np.linalg.norm(v) for _, u, v, _ in faces]
    value = sum(area * report["mean"]["value"] for area, report in zip(areas, reports))
    # Errors of different faces may have one cause.
    expanded = sum(area * report["mean"]["expanded"] for area, report in zip(areas, reports))
    # Of 1600 points, the mean of a face differs from the integral by less than this share.
    yield "10,000 lm on six faces", [(value, expanded + 2e-4 * value)], [10_000.0]


def glass_angles(own):
    sheet = [quad("glass", (-20, 0, -20), (40, 0, 0), (0, 0, 40))]
    readings, references = [], []
    for degrees in (0, 10, 20, 30, 40, 50, 60, 70, 75, 80, 85):
        angle = math.radians(degrees)
        along = [math.sin(angle), -math.cos(angle), 0.0]
        light = f'[[light]]\ntype = "sun"\ndirection = {along}\nlux = 1000\n'
        toward = [-x for x in along]
        readings += single(measure(sheet, light, [((0, -0.5, 0), toward)], 0.2 * own.seconds))
        references.append(1000 * float(pane(math.cos(angle))))
    yield "0 to 85 degrees", readings, references


def reflection(own):
    floor = {"floor": f"albedo = {0.3}"}
    light = '[[light]]\ntype = "sun"\ndirection = [0, -1, 0]\nlux = 1000\n'
    one = lambda toward: 300 / math.pi + 0 * toward[..., 0]
    for side, name in ((4.0, "4 m"), (0.5, "0.5 m"), (500.0, "500 m")):
        low = 2 - side / 2
        corner, u, v = (low, 0, low), (0, 0, side), (side, 0, 0)
        meters = [((2, y, 0), NORTH) for y in HEIGHTS] + [((2, 3, z), DOWN) for z in DEPTHS]
        readings = single(measure([quad("floor", corner, u, v)], light, meters, own.seconds, floor))
        at = [(0.0 - low) / side]
        middle = [(2.0 - low) / side]
        references = [through(*m, corner, u, v, one, ([*at, (m[0][2] - low) / side], middle), 40) for m in meters]
        yield f"{name} wide", readings, references


def obstruction(own):
    wall = {"wall": f"albedo = {0.6}"}
    angle = math.radians(60)
    light = f'[[light]]\ntype = "sun"\ndirection = [0, {-math.sin(angle)}, {math.cos(angle)}]\nlux = 2000\n'
    corner, u, v = (0, 0, 4), (0, 3, 0), (4, 0, 0)
    low, high = np.array((0, 0, 2.5)), np.array((4, 1, 2.7))
    # A black roof, under which the sun reaches the wall alone.
    quads = [quad("wall", corner, u, v), quad("black", (-9, 3.01, -9), (22, 0, 0), (0, 0, 11.2)), *box(low, high, "black")]
    meters = [((2, y, 0), NORTH) for y in HEIGHTS] + [((2, 0, z), UP) for z in DEPTHS[:5]]
    readings = single(measure(quads, light, meters, own.seconds, wall))
    # 1000 lx reach the wall, which reflects 60 %.
    references = []
    for position, normal in meters:
        # Rays over the upper edges of the box meet the wall above these heights.
        edges = [position[1] + (1 - position[1]) * (4 - position[2]) / (z - position[2]) for z in (2.5, 2.7)]
        above = max(edges)
        seen = lambda toward, p=position: (600 / math.pi) * (
            p[1] + toward[..., 1] / toward[..., 2] * (4 - p[2]) > above if above > 0 else np.ones(toward.shape[:-1])
        )
        references.append(through(position, normal, corner, u, v, seen, ([above / 3], ())))
    yield "wall of 60 %", readings, references


def interreflection(own):
    grid = "corner = [0, 0, 0]\nedges = [[4, 0, 0], [0, 0, 4]]\ncolumns = 40\nrows = 40\nnormal = [0, 1, 0]\n"
    middle = (np.arange(40) + 0.5) / 10
    x, z = np.meshgrid(middle, middle)
    candela = 10_000 / (4 * math.pi)
    direct = float(np.mean(candela * 2 / ((x - 2) ** 2 + (z - 2) ** 2 + 4) ** 1.5))
    light = '[[light]]\ntype = "point"\nposition = [2, 2, 2]\nlumen = 10000\n'
    readings, references = [], []
    for share in (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95):
        quads = room(height=4.0, material="gray")
        [report] = measure(quads, light, [grid], own.seconds, {"gray": f"albedo = {share}"}, ["--mean"])
        readings.append((report["mean"]["value"], report["mean"]["expanded"]))
        references.append(direct + 10_000 / 96 * share / (1 - share))
    yield "reflectances .05 to .95", readings, references


def roof_openings(own, glazed):
    for side in (1.0, 4.0):
        low = 2 - side / 2
        opening = [(low, low), (low + side, low + side)]
        corner, u, v = (low, HEIGHT, low), (side, 0, 0), (0, 0, side)
        meters = [((2, y, 0), NORTH) for y in HEIGHTS] + [((2, 0, z), UP) for z in DEPTHS]
        quads = room(roof=opening) + ([quad("glass", corner, u, v)] if glazed else [])
        for kind in own.skies:
            seen = behind_pane(sky(kind), 1) if glazed else sky(kind)
            readings = single(measure(quads, sky_keys(kind), meters, own.seconds))
            middle = [(2.0 - low) / side]
            references = [through(*m, corner, u, v, seen, (middle, [(m[0][2] - low) / side])) for m in meters]
            yield f"{side:g} m, sky {kind}", readings, references


def facade(own, openings, glazed=False, masks=(None,), ceiling=True):
    for (width, height, sill), (mask, size) in itertools.product(openings, [own_mask or (None, 0) for own_mask in masks]):
        low = 2 - width / 2
        opening = [(low, sill), (low + width, sill + height)]
        corner, u, v = (low, sill, 0), (width, 0, 0), (0, height, 0)
        meters = [((2, y, 4), SOUTH) for y in HEIGHTS] + [((2, 0, z), UP) for z in DEPTHS]
        meters += [((2, HEIGHT, z), DOWN) for z in DEPTHS] if ceiling else []
        quads = room(facade=opening) + ([quad("glass", corner, u, v)] if glazed else [])
        if mask == "horizontal":
            quads.append(quad("black", (-98, HEIGHT, -size), (200, 0, 0), (0, 0, size)))
        if mask == "vertical":
            quads.append(quad("black", (-998, 0, -6), (2000, 0, 0), (0, size, 0)))
        for kind in own.skies:
            bare = behind_pane(sky(kind), 2) if glazed else sky(kind)
            readings = single(measure(quads, sky_keys(kind), meters, own.seconds))
            references = []
            for (x, y, z), normal in meters:
                # Heights in the plane of the facade at which rays pass the horizon and the edge of the mask.
                breaks, hidden = [y], None
                if mask == "horizontal":
                    edge = y + (HEIGHT - y) * z / (z + size)
                    hidden = lambda toward, y=y, z=z, edge=edge: y - toward[..., 1] / toward[..., 2] * z > edge
                elif mask == "vertical":
                    edge = y + (size - y) * z / (z + 6)
                    least = y - y * z / (z + 6)
                    breaks.append(least)
                    hidden = lambda toward, y=y, z=z, edge=edge, least=least: (
                        (y - toward[..., 1] / toward[..., 2] * z < edge)
                        & (y - toward[..., 1] / toward[..., 2] * z > least)
                    )
                if hidden is not None:
                    breaks.append(edge)
                seen = bare if hidden is None else lambda t, hidden=hidden: np.where(hidden(t), 0.0, bare(t))
                places = [(place - sill) / height for place in breaks]
                references.append(through((x, y, z), normal, corner, u, v, seen, ([0.5], places)))
            name = f"{width:g} m by {height:g} m, sky {kind}" + (f", mask {size:g} m" if mask else "")
            yield name, readings, references


SMALL, LARGE = (2.0, 1.0, 1.0), (4.0, 3.0, 0.0)
HORIZONTAL = [("horizontal", size) for size in (0.5, 1.0, 2.0)]
VERTICAL = [("vertical", size) for size in (3.0, 6.0, 9.0)]
CASES = {
    "5.2": ("point sources", point_sources),
    "5.3": ("area source", area_source),
    "5.4": ("conservation of flux", flux),
    "5.5": ("clear glass by angle", glass_angles),
    "5.6": ("reflection by diffuse surfaces", reflection),
    "5.7": ("reflection beside an obstruction", obstruction),
    "5.8": ("interreflection in a cube", interreflection),
    "5.9": ("roof opening, skies", lambda own: roof_openings(own, False)),
    "5.10": ("glazed roof opening, skies", lambda own: roof_openings(own, True)),
    "5.11": ("facade opening, sky and ground", lambda own: facade(own, [SMALL, LARGE])),
    "5.12": ("glazed facade opening", lambda own: facade(own, [SMALL, LARGE], glazed=True)),
    "5.13": ("facade below a horizontal mask", lambda own: facade(own, [SMALL], masks=HORIZONTAL, ceiling=False)),
    "5.14": ("facade before a vertical mask", lambda own: facade(own, [SMALL], masks=VERTICAL, ceiling=False)),
}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE", help="numbers of cases, such as 5.8 [default: all]")
    parser.add_argument("--seconds", type=float, default=2.0, help="for each variant")
    parser.add_argument("--skies", default="1,2,3,4,5,6,7,8,9,10,11,12,13,14,15", help="types of the CIE general sky")
    parser.add_argument("--points", action="store_true", help="print every point")
    own = parser.parse_args()
    own.skies = [int(kind) for kind in own.skies.split(",")]
    unknown = [case for case in own.cases if case not in CASES]
    if unknown:
        parser.error(f"there is no case {', '.join(unknown)}")
    return own


def main():
    own = arguments()
    print("| case | | points | within | unknown | largest z | largest deviation | mean |", flush=True)
    print("|---|---|---|---|---|---|---|---|", flush=True)
    is_bad = False
    for case in own.cases or CASES:
        name, run = CASES[case]
        count, held, unknown, largest, worst, total, expected = 0, 0, 0, 0.0, (0.0, 0.0, ""), 0.0, 0.0
        for variant, readings, references in run(own):
            most = max(references)
            for index, ((value, expanded), reference) in enumerate(zip(readings, references)):
                if not (math.isfinite(value) and math.isfinite(expanded)):
                    # Too few paths saw light to say anything.
                    count, unknown = count + 1, unknown + 1
                    continue
                deviation = value - reference
                # Quadrature and the numbers of the scene file are exact to this share.
                width = expanded + 1e-4 * reference
                z = abs(deviation) / width if width > 0 else (0.0 if deviation == 0 else math.inf)
                count, held, largest = count + 1, held + (z <= 1), max(largest, z)
                total, expected = total + value, expected + reference
                if reference > 0.01 * most:
                    relative = abs(deviation) / reference
                    worst = max(worst, (relative, expanded / reference, f"{variant}, point {index + 1}"))
                    is_bad |= z > 2 and relative > 0.01
                if own.points:
                    print(f"  {case} {variant} {index + 1}: {value:.5g} +- {expanded:.2g}, {reference:.5g}, z {z:.2f}", file=sys.stderr)
        is_bad |= held < 0.9 * count
        deviation = f"{100 * worst[0]:.2f} % (± {100 * worst[1]:.2f} %)"
        print(f"| {case} | {name} | {count} | {held} | {unknown} | {largest:.2f} | {deviation} | {total / expected:.4f} |", flush=True)
        print(f"{case}: worst at {worst[2]}", file=sys.stderr)
    sys.exit(is_bad)


if __name__ == "__main__":
    main()
