"""IES Texture nodes of lights: the intensity that Cycles computes from them, as a photometric file for bdpm.

Cycles reads IES files by rules of its own (`util/ies.cpp`, `kernel/util/ies.h`, `kernel/svm/ies.h`): gamma = 0 is along
the light's -z, C0 is along -y and C90 along -x. Its C angles run clockwise as seen from above, those of bdpm
counterclockwise. Its axes for files of the types A and B are not those of the standard. It interpolates by cubics. The
exported file has Cycles' values in bdpm's frame, on a grid that is fine enough for bilinear interpolation.
"""

import os

import bpy
import numpy as np

# Cycles' W per cd: 4 pi / 177.83, the efficacy of D65 in lm/W.
WATTS_PER_CANDELA = 0.0706650768394
# Output of the node, per unit of its strength, for a file that Cycles cannot read.
UNREADABLE = 100.0
# lm/W, as bdpm defines its units.
LUMENS_PER_WATT = 683.0
# Factor on the candela of an exported file for a light of 1 W, whose intensity is the node's output over 4 pi.
SCALE_PER_WATT = LUMENS_PER_WATT * WATTS_PER_CANDELA / (4 * np.pi)
TYPE_C, TYPE_B, TYPE_A = 1, 2, 3
# Largest step of the exported grid and width of a jump, degrees.
STEP, JUMP = 1.0, 1e-3
# Angles of the grid in the smooth edge of a spot.
CONE_ANGLES = 33


class Distribution:
    """`values[h, v]`, the output of the node per unit of its strength, at Cycles' angles in degrees."""

    def __init__(self, h, v, values):
        self.h, self.v, self.values = h, v, values

    def at(self, directions):
        """Values for vectors of shape (..., 3) in the space of the light, of any length above 0."""
        x, y, z = np.moveaxis(directions, -1, 0)
        v = np.degrees(np.arctan2(np.hypot(x, y), -z))
        h = np.degrees(np.arctan2(x, y)) + 180
        # Next to the seam rounding may lead to either end of a full turn.
        h = np.minimum(h, 360 - 1e-9)
        inside = (v >= self.v[0]) & (v <= self.v[-1]) & (h >= self.h[0]) & (h <= self.h[-1])
        i, s = _interval(self.h, h)
        last = len(self.h) - 1
        b, c = self._along_v(i, v), self._along_v(i + 1, v)
        # Cycles does not interpolate across 0 and 360 degrees: of the rounded angle, it asks whether it exceeds a turn.
        a = np.where(i > 0, self._along_v(np.maximum(i - 1, 0), v), b)
        d = np.where(i + 2 <= last, self._along_v(np.minimum(i + 2, last), v), b)
        return np.where(inside, np.maximum(_cubic(a, b, c, d, s), 0), 0)

    def _along_v(self, h, v):
        j, t = _interval(self.v, v)
        last = len(self.v) - 1
        b, c = self.values[h, j], self.values[h, j + 1]
        low = self.values[h, 1] if self.v[0] < 1e-5 else b
        a = np.where(j > 0, self.values[h, np.maximum(j - 1, 0)], low)
        d = np.where(j + 2 <= last, self.values[h, np.minimum(j + 2, last)], c)
        return _cubic(a, b, c, d, t)


def _interval(angles, at):
    index = np.clip(np.searchsorted(angles, at, side="left") - 1, 0, len(angles) - 2)
    return index, np.clip((at - angles[index]) / (angles[index + 1] - angles[index]), 0, 1)


def _cubic(a, b, c, d, x):
    return 0.5 * (((d + 3 * (b - c) - a) * x + (2 * a - 5 * b + 4 * c - d)) * x + (c - a)) * x + b


def parse(text):
    """The distribution that Cycles has for a file. Raises ValueError where Cycles cannot read it."""
    head, found, rest = text.replace(",", " ").replace("\r", "").partition("\nTILT=")
    if not found:
        raise ValueError("there is no line TILT=")
    tilt, _, rest = rest.partition("\n")
    words = iter(rest.split())

    def numbers(count):
        try:
            return [float(next(words)) for _ in range(count)]
        except StopIteration:
            raise ValueError("it ends too early") from None

    if tilt.startswith("INCLUDE"):
        numbers(2 * int(numbers(2)[1]))
    _, _, factor, v_count, h_count, kind = numbers(6)
    *_, ballast, photometric, _ = numbers(7)
    v, h = np.array(numbers(int(v_count))), np.array(numbers(int(h_count)))
    values = np.array(numbers(len(h) * len(v))).reshape(len(h), len(v))
    values *= factor * ballast * photometric * WATTS_PER_CANDELA
    if kind not in _TURNED or not len(h) or not len(v):
        raise ValueError("its photometric type or its number of angles is unknown")
    h, v, values = _TURNED[kind](h, v, values)
    if len(h) < 2 or len(v) < 2 or (np.diff(h) <= 0).any() or (np.diff(v) <= 0).any():
        raise ValueError("its angles do not ascend")
    return Distribution(h, v, values)


def _turned_a(h, v, values):
    h, values = 180 - h[::-1], values[::-1]
    if abs(h[-1] - 180) < 1e-4:
        h, values = np.append(h, 360 - h[-2::-1]), np.vstack([values, values[-2::-1]])
    return h, v + 90, values


def _turned_b(h, v, values):
    def turned(angles, values):
        if abs(angles[0]) < 1e-4:
            return np.append(90 - angles[:0:-1], 90 + angles), np.vstack([values[:0:-1], values])
        return angles + 90, values

    h, v, values = v, h, values.T
    h, values = turned(h, values)
    v, across = turned(v, values.T)
    return h, v, across.T


def _turned_c(h, v, values):
    if abs(h[0] - 90) < 1e-4:
        h = h - 90
    if len(h) == 1:
        return np.array([0.0, 360.0]), v, np.vstack([values, values])
    for end in (90, 180):
        if abs(h[-1] - end) < 1e-4:
            h, values = np.append(h, 2 * end - h[-2::-1]), np.vstack([values, values[-2::-1]])
    gap = 360 - h[-1]
    if abs(h[0]) < 1e-4 < gap and min(abs(h[-1] - h[-2] - gap), abs(h[1] - h[0] - gap)) < 1e-4:
        h, values = np.append(h, 360.0), np.vstack([values, values[:1]])
    return h, v, values


_TURNED = {TYPE_A: _turned_a, TYPE_B: _turned_b, TYPE_C: _turned_c}


class IesNode:
    """An IES Texture node behind a strength, and the factor on its output."""

    def __init__(self, source, factor):
        self.source, self.factor = source, factor

    def distribution(self, remark):
        """Its distribution, or None, with a remark, if it has no file that can be read."""
        node = self.source.node
        if self.source.input("Vector").source()[0] is not None:
            remark(f"{node.name}: its vector is ignored; took the direction of the light")
        try:
            return parse(_text(node))
        except ValueError as problem:
            remark(
                f"{node.name}: its IES file {_file_name(node)} cannot be read ({problem}); "
                f"took the constant {UNREADABLE:g}, as Cycles does"
            )
            return None


def find(socket, evaluator):
    """The node behind a strength, directly or through products and quotients with constants; or None."""
    source, _ = socket.source()
    if source is None:
        return None
    node = source.node
    if node.type == "TEX_IES":
        return IesNode(source, evaluator.constant(source.input("Strength"), "Strength"))
    if node.type != "MATH" or node.operation not in {"MULTIPLY", "DIVIDE"} or node.use_clamp:
        return None
    first, second = (type(socket)(one, source.groups) for one in list(node.inputs)[:2])
    pairs = [(first, second), (second, first)] if node.operation == "MULTIPLY" else [(first, second)]
    for one, other in pairs:
        found = find(one, evaluator)
        if found is not None:
            number = evaluator.constant(other, "Value")
            if node.operation == "DIVIDE":
                # Blender has 0 for a quotient by 0.
                number = 1 / number if number else 0.0
            return IesNode(found.source, found.factor * number)
    return None


def _file_name(node):
    if node.mode == "INTERNAL":
        return node.ies.name if node.ies else ""
    return bpy.path.abspath(node.filepath, library=node.id_data.library)


def _text(node):
    if not _file_name(node):
        raise ValueError("none is selected")
    if node.mode == "INTERNAL":
        return node.ies.as_string()
    try:
        with open(_file_name(node), encoding="latin-1", newline="") as file:
            return file.read()
    except OSError as error:
        raise ValueError(error.strerror) from None


def frame(matrix):
    """Axes of the luminaire in the world, as columns: C0, C90 and up, for the matrix of a light."""
    up = matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    c0 = -matrix[:3, 1] + (matrix[:3, 1] @ up) * up
    c0 /= np.linalg.norm(c0)
    return np.column_stack([c0, np.cross(up, c0), up])


class Cone:
    """The factor of a spot of this half angle, radians: smooth between its edge and an inner angle.

    Its `edges` are angles from the axis, degrees, between which the intensity may jump.
    """

    def __init__(self, half, blend):
        self._cosine = np.cos(half)
        self._width = (1 - self._cosine) * blend
        inner = np.arccos(self._cosine + self._width)
        self.edges = np.degrees(np.linspace(inner, half, CONE_ANGLES) if blend > 0 else [half])

    def __call__(self, cosines):
        """The factor in directions of these cosines to the axis."""
        t = np.clip((cosines - self._cosine) / max(self._width, 1e-9), 0, 1)
        return t * t * (3 - 2 * t)


class OneSide:
    """The factor of an area, over that of a point of equal power: an area has the intensity P cos/pi at its front."""

    edges = (90.0,)

    def __call__(self, cosines):
        return 4 * np.maximum(cosines, 0)


def lm63(distribution, matrix, opening, factor=None):
    """The text of an LM-63 file of type C in the `frame` of this matrix: candela for a light of 1 W.

    `opening` has the width, length and height of the luminous opening as such files encode them, m. `factor`, such as a
    Cone, is that of the intensity by the cosine to the axis.
    """
    axes = frame(matrix)
    c = _grid(np.concatenate([distribution.h, 360 - distribution.h]), 360.0)
    gamma = _grid(np.append(distribution.v, factor.edges if factor else []), 180.0)
    # The last plane is that of 0 degrees.
    turn, fall = np.radians(np.append(c[:-1], 0))[:, None], np.radians(gamma)
    down = -np.cos(fall) + 0 * turn
    own = np.stack([np.cos(turn) * np.sin(fall), np.sin(turn) * np.sin(fall), down], axis=-1)
    # Cycles takes normals, whose matrix is the inverse of the transpose, from the world to the light.
    candela = distribution.at(own @ axes.T @ matrix[:3, :3]) / WATTS_PER_CANDELA
    if factor:
        candela *= factor(-down)
    if np.ptp(candela, axis=0).max() <= 1e-6 * candela.max():
        c, candela = np.zeros(1), candela[:1]
    lines = ["IESNA:LM-63-2002", "[MANUFAC] IES Texture node of Blender", "TILT=NONE"]
    size = " ".join(f"{number:.7g}" for number in opening)
    lines += [f"1 -1 1 {len(gamma)} {len(c)} 1 2 {size}", "1 1 0"]
    for row in (gamma, c, *candela):
        lines += [" ".join(f"{number:.7g}" for number in row[k : k + 16]) for k in range(0, len(row), 16)]
    return "\n".join(lines) + "\n"


def _grid(angles, end):
    """Angles from 0 to `end` in small steps, with both sides of those where the distribution may jump."""
    angles = np.unique(np.clip(np.round(np.append(angles, [0, end]), 6), 0, end))
    # Equal angles that were rounded differently are one.
    angles = angles[np.append(True, np.diff(angles) > 4 * JUMP)]
    angles[-1] = end
    steps = [np.linspace(a, b, int(np.ceil((b - a) / STEP)), endpoint=False) for a, b in zip(angles, angles[1:])]
    inner = angles[1:-1]
    return np.unique(np.round(np.concatenate([*steps, inner - JUMP, inner + JUMP, [0, end]]), 6))


class Files:
    """IES files of a scene's folder; equal ones are one file."""

    def __init__(self, folder):
        self._folder = folder
        self._names = {}

    def write(self, text):
        """The name of the file in the folder."""
        if text not in self._names:
            name = f"luminaire{len(self._names)}.ies"
            with open(os.path.join(self._folder, name), "w", encoding="ascii") as file:
                file.write(text)
            self._names[text] = name
        return self._names[text]
