"""How often the interval that `bdpm measure` states holds the true value: docs/measurements/meter-intervals.md.

    scripts/meter_intervals.py measure CASE STRATEGY RUNS [LIMIT]   renders what is missing of this many runs
    scripts/meter_intervals.py reference CASE MINUTES               extends the reference of a case without a closed form
    scripts/meter_intervals.py table                                prints a row for each case, strategy and limit
    scripts/meter_intervals.py coverage RUNS SECONDS [MINUTES]      does all of that for the seven situations of
                                                                    scripts/meter_situations.py, with references of
                                                                    this many minutes each (10 by default)

CASE is furnace, sphere, caustics, or a situation: l-corridor, glass-ball, window, room, bend, sky, globe. STRATEGY is `chosen` for the automatic one. LIMIT is a target such as 3% (the default) or a time such as 3s. The program
is $BDPM, or else target/release/bdpm. Results are kept in target/measured/meter-intervals, so that a stopped run
continues. The table needs numpy.
"""

import collections
import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path

from meter_situations import SITUATIONS

ROOT = Path(__file__).resolve().parent.parent
FOLDER = Path(os.environ.get("MEASURED", ROOT / "target/measured")) / "meter-intervals"
PROGRAM = os.environ.get("BDPM", ROOT / "target/release/bdpm")
# lm/W, docs/reference/scene-format.md#units
LUMENS = 683.0
# Seconds and first seed of each render of a reference
REFERENCE_SECONDS, REFERENCE_SEED = 60, 1_000_000
# Path tracing, which has no bias, finds the light of a sun behind glass too rarely: its renders of a minute differ by a
# factor of 2.6. Merging within twice this radius changes no reading by more than .4 %.
BY_PHOTONS = {"window": ["--strategy", "mis", "--radius", "0.02", "--caustic-radius", "0.02"]}

CAMERA = "[camera]\nposition = [0, 0, 0]\ntarget = [0.5, 0.4, 0]\nfov_x_deg = 60\n"


def furnace(folder):
    """A closed box of albedo 0.5 whose walls emit 1 W/(m^2 sr): the radiance is 2 everywhere."""
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    # Counterclockwise as seen from inside
    faces = [(3, 4, 2, 1), (6, 8, 7, 5), (2, 6, 5, 1), (7, 8, 4, 3), (5, 7, 3, 1), (4, 8, 6, 2)]
    write_obj(folder / "mesh.obj", corners, faces)
    places = [((0, 0.1, -0.2), (0, 0, 1)), ((0.5, 0.1, -0.2), (0, 0, 1))]
    text = CAMERA + '[[mesh]]\nfile = "mesh.obj"\nmaterial = "wall"\n'
    text += "[materials.wall]\nalbedo = 0.5\nemission = 1\n"
    return text, places, [LUMENS * math.pi * 2] * len(places)


def sphere(folder):
    """An integrating sphere of albedo 0.5 with a point light of 1 W/sr off its center.

    Light that was reflected is the same everywhere on its wall: the flux times albedo/(1 - albedo), over the area.
    """
    points, faces = icosphere(5)
    write_obj(folder / "mesh.obj", points, [[index + 1 for index in face[::-1]] for face in faces])
    area = sum(triangle_area(*(points[index] for index in face)) for face in faces)
    lamp = (0.5, 0.2, 0.1)
    text = CAMERA + '[[mesh]]\nfile = "mesh.obj"\nmaterial = "wall"\n[materials.wall]\nalbedo = 0.5\n'
    text += f'[[light]]\ntype = "point"\nposition = {list(lamp)}\nintensity = 1\n'
    indirect = 4 * math.pi / area
    places, values = [], []
    for direction in ((1, 0, 0), (0, -1, 0), (-0.6, 0, 0.8)):
        # As close to the wall as its facets allow: what is below the meter's horizon is not in the closed form.
        position = tuple(0.9995 * x for x in direction)
        normal = tuple(-x for x in direction)
        to_lamp = [a - b for a, b in zip(lamp, position)]
        distance = math.sqrt(dot(to_lamp, to_lamp))
        places.append((position, normal))
        values.append(LUMENS * (dot(to_lamp, normal) / distance**3 + indirect))
    return text, places, values


def caustics(folder):
    """scenes/caustic-sphere with meters on the floor: below the ball of glass, beside it, and farther away."""
    scene = ROOT / "scenes/caustic-sphere"
    text = (scene / "scene.toml").read_text()
    for name in ("room.obj", "ball.obj"):
        text = text.replace(f'"{name}"', json.dumps(str(scene / name)))
    up = (0, 1, 0)
    return text, [((0.75, 0.001, 0.2), up), ((0.1, 0.001, 0.6), up), ((-2.0, 0.001, 1.5), up)], None


CASES = {"furnace": furnace, "sphere": sphere, "caustics": caustics, **SITUATIONS}


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def triangle_area(a, b, c):
    u, v = [y - x for x, y in zip(a, b)], [y - x for x, y in zip(a, c)]
    cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    return 0.5 * math.sqrt(dot(cross, cross))


def icosphere(levels):
    """Points on the unit sphere and triangles, counterclockwise as seen from outside."""
    golden = (1 + math.sqrt(5)) / 2
    points = []
    for a, b in ((-1, golden), (1, golden), (-1, -golden), (1, -golden)):
        points += [(a, b, 0), (0, a, b), (b, 0, a)]
    points = [normalized(point) for point in points]
    near = [[i != j and dot(points[i], points[j]) > 0.4 for j in range(12)] for i in range(12)]
    faces = []
    for i in range(12):
        for j in range(i + 1, 12):
            for k in range(j + 1, 12):
                if near[i][j] and near[j][k] and near[i][k]:
                    faces.append(outward(points, (i, j, k)))
    for _ in range(levels):
        middles = {}

        def middle(i, j):
            key = (min(i, j), max(i, j))
            if key not in middles:
                middles[key] = len(points)
                points.append(normalized([x + y for x, y in zip(points[i], points[j])]))
            return middles[key]

        finer = []
        for i, j, k in faces:
            a, b, c = middle(i, j), middle(j, k), middle(k, i)
            finer += [(i, a, c), (a, j, b), (c, b, k), (a, b, c)]
        faces = finer
    return points, faces


def outward(points, face):
    a, b, c = (points[index] for index in face)
    volume = dot(a, (b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]))
    return face if volume > 0 else (face[0], face[2], face[1])


def normalized(point):
    length = math.sqrt(dot(point, point))
    return tuple(x / length for x in point)


def write_obj(path, points, faces):
    lines = ["v " + " ".join(repr(float(x)) for x in point) for point in points]
    lines += ["f " + " ".join(str(index) for index in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")


def prepare(case):
    """Writes the scene file of a case. Returns its name and the true values of its meters, lx, or None."""
    folder = FOLDER / case
    folder.mkdir(parents=True, exist_ok=True)
    text, places, values = CASES[case](folder)
    for position, normal in places:
        text += f"\n[[meter]]\nposition = {list(position)}\nnormal = {list(normal)}\n"
    path = folder / "scene.toml"
    path.write_text(text)
    return path, values


def run(path, seed, *options):
    """A line of the results: value, expanded uncertainty and noise of each meter, lx, and the technique."""
    command = [PROGRAM, "measure", path, "--seed", str(seed), "--json", "--quiet", *options]
    process = subprocess.run(command, capture_output=True, text=True)
    # Status 3: some readings are unknown.
    if process.returncode not in (0, 3):
        sys.exit(f"{' '.join(map(str, command))}: {process.stderr}")
    result = json.loads(process.stdout)
    meters = [one["readings"][0] for one in result["meters"]]
    keep = ("value", "expanded", "noise", "bias")
    readings = [[meter[key] for key in keep] for meter in meters]
    return {"seed": seed, "readings": readings, "technique": result["techniques"][0], "seconds": result["seconds"]}


def results(name):
    path = FOLDER / f"{name}.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def append(name, line):
    with open(FOLDER / f"{name}.jsonl", "a", encoding="ascii") as file:
        file.write(json.dumps(line) + "\n")


def measure(case, strategy, runs, limit="3%"):
    path, _ = prepare(case)
    own = ["--target-error" if limit.endswith("%") else "--time", limit]
    if strategy != "chosen":
        own += ["--strategy", strategy]
    name = f"{case}_{strategy}_{limit}"
    for seed in range(len(results(name)), int(runs)):
        append(name, run(path, seed, *own))


def reference(case, minutes):
    """Renders by path tracing, which has no bias, or by photons where it fails."""
    path, values = prepare(case)
    if values is not None:
        sys.exit(f"{case} has a closed form and needs no reference")
    options = BY_PHOTONS.get(case, ["--strategy", "path"])
    name, start = f"{case}_reference", time.monotonic()
    while time.monotonic() < start + 60 * float(minutes):
        seed = REFERENCE_SEED + len(results(name))
        append(name, run(path, seed, "--time", f"{REFERENCE_SECONDS}s", *options))


def coverage(runs, seconds, minutes="10"):
    """Measures all situations and their references as far as that is missing, and prints the table."""
    for case in SITUATIONS:
        measure(case, "chosen", runs, f"{seconds}s")
        done = REFERENCE_SECONDS / 60 * len(results(f"{case}_reference"))
        # The standard error of a reference needs two renders.
        reference(case, max(float(minutes) - done, 0 if done >= 2 else 2))
    table()


def true_values(case):
    """Values of the meters and their standard errors, lx."""
    import numpy as np

    _, values = prepare(case)
    if values is not None:
        return np.array(values), np.zeros(len(values))
    renders = np.array([line["readings"] for line in results(f"{case}_reference")])
    return renders[:, :, 0].mean(axis=0), renders[:, :, 0].std(axis=0, ddof=1) / math.sqrt(len(renders))


def table():
    import numpy as np

    heads = ["case", "strategy", "limit", "runs", "held", "too low", "too high", "unknown", "held by noise alone"]
    heads += ["stated over true spread", "error of the reference over the stated", "bias, stated", "bias, true"]
    print(f"| {' | '.join(heads)} |\n|{len(heads) * '---|'}")
    for path in sorted(FOLDER.glob("*.jsonl")):
        case, strategy, *limit = path.stem.split("_")
        if strategy == "reference":
            continue
        lines = results(path.stem)
        if CASES[case](FOLDER / case)[2] is None and len(results(f"{case}_reference")) < 2:
            print(f"{path.stem}: run `reference {case} MINUTES` first", file=sys.stderr)
            continue
        truth, deviation = true_values(case)
        # Unknown readings are NaN. They state no interval, and count in none of the means.
        readings = np.array([line["readings"] for line in lines], float)
        value, expanded, _, bias = np.moveaxis(readings, -1, 0)
        is_known = np.isfinite(value) & np.isfinite(expanded)
        error = np.where(is_known, value - truth, np.nan)
        held, by_noise = np.abs(error) <= expanded, np.abs(error) <= expanded - bias
        low, high = (100 * (error * sign > expanded)[is_known].mean() for sign in (-1, 1))
        # Meters of a run are not independent: the deviation is over runs.
        whole = is_known.any(axis=1)
        of_run = held[whole].sum(axis=1) / is_known[whole].sum(axis=1)
        share, spread = 100 * held[is_known].mean(), 100 * of_run.std(ddof=1) / math.sqrt(len(of_run))
        squares = np.maximum(np.nanmean(error**2, axis=0) - deviation**2, 0)
        stated_squares = np.nanmean(np.where(is_known, expanded, np.nan) ** 2, axis=0)
        ratio = np.sqrt(stated_squares / (1.96**2 * squares)).mean()
        of_reference = (deviation / np.sqrt(stated_squares)).max()
        true_bias = np.nanmean(error, axis=0) / truth
        scatter = np.nanstd(np.where(is_known, value, np.nan), axis=0, ddof=1) / math.sqrt(len(lines)) / truth
        signed = ", ".join(f"{100 * b:+.2f} +- {100 * s:.2f} %" for b, s in zip(true_bias, scatter))
        stated = 100 * np.nanmean(np.where(is_known, bias / value, np.nan))
        cells = [case, strategy, *limit, len(lines)]
        cells += [f"{share:.1f} +- {spread:.1f} %", f"{low:.1f} %", f"{high:.1f} %", np.count_nonzero(~is_known)]
        cells += [f"{100 * by_noise[is_known].mean():.1f} %", f"{ratio:.2f}", f"{of_reference:.2f}"]
        cells += [f"{stated:.2f} %", signed]
        print(f"| {' | '.join(map(str, cells))} |")
        names = collections.Counter(line["technique"].split(": ", 1)[1].rsplit(", ", 3)[0] for line in lines)
        print(f"  {path.stem}: {dict(names)}", file=sys.stderr)


if __name__ == "__main__":
    commands = {"measure": measure, "reference": reference, "table": table, "coverage": coverage}
    if len(sys.argv) < 2 or sys.argv[1] not in commands:
        sys.exit(__doc__)
    commands[sys.argv[1]](*sys.argv[2:])
