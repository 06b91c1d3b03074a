"""Seven situations in which light is hard to measure, for scripts/meter_intervals.py.

Each function writes the meshes of a scene to a folder. It returns the text of the scene file without meters, the places of
the meters as positions and normals, and None, since there is no closed form. Units are meters; +y is up.
"""

import math

UP = (0, 1, 0)
CAMERA = "[camera]\nposition = [{}, {}, {}]\ntarget = [{}, {}, {}]\nfov_x_deg = 60\n"
MATTE = '[materials.{}]\ntype = "lambertian"\nalbedo = {}\n'
LAMP = '[materials.lamp]\ntype = "lambertian"\nalbedo = 0\nemission = {}\n'


class Model:
    """Quadrangles and triangles, one OBJ file for each material."""

    def __init__(self):
        self.faces = {}

    def quad(self, material, corner, u, v):
        """A parallelogram; its front sees the side of the cross product of u and v."""
        b = tuple(x + y for x, y in zip(corner, u))
        d = tuple(x + y for x, y in zip(corner, v))
        c = tuple(x + y for x, y in zip(b, v))
        self.faces.setdefault(material, []).append((corner, b, c, d))

    def box(self, material, low, high, open_sides=()):
        """The inside of a box. Sides that are left open are named -x, +x and so on."""
        size = [b - a for a, b in zip(low, high)]
        for axis, name in enumerate("xyz"):
            edges = [[0, 0, 0], [0, 0, 0]]
            edges[0][(axis + 1) % 3] = size[(axis + 1) % 3]
            edges[1][(axis + 2) % 3] = size[(axis + 2) % 3]
            if f"-{name}" not in open_sides:
                self.quad(material, tuple(low), *edges)
            if f"+{name}" not in open_sides:
                corner = list(low)
                corner[axis] = high[axis]
                self.quad(material, tuple(corner), *edges[::-1])

    def solid(self, material, low, high):
        """The outside of a box."""
        size = [b - a for a, b in zip(low, high)]
        for axis in range(3):
            edges = [[0, 0, 0], [0, 0, 0]]
            edges[0][(axis + 1) % 3] = size[(axis + 1) % 3]
            edges[1][(axis + 2) % 3] = size[(axis + 2) % 3]
            self.quad(material, tuple(low), *edges[::-1])
            corner = list(low)
            corner[axis] = high[axis]
            self.quad(material, tuple(corner), *edges)

    def ball(self, material, center, radius, inward=False, around=48, down=24):
        """A ball of flat facets, whose fronts are outside unless they are turned inward."""
        def point(row, column):
            theta, phi = math.pi * row / down, 2 * math.pi * (column % around) / around
            unit = (math.sin(theta) * math.cos(phi), math.cos(theta), math.sin(theta) * math.sin(phi))
            return tuple(c + radius * x for c, x in zip(center, unit))

        faces = self.faces.setdefault(material, [])
        for row in range(down):
            for column in range(around):
                a, b = point(row, column), point(row, column + 1)
                c, d = point(row + 1, column), point(row + 1, column + 1)
                for face in [(a, b, d)] * (row > 0) + [(a, d, c)] * (row < down - 1):
                    faces.append(face[::-1] if inward else face)

    def write(self, folder):
        """Writes the files, and returns the tables of the meshes."""
        text = ""
        for material, faces in self.faces.items():
            lines, count = [], 0
            for face in faces:
                lines += ["v " + " ".join(repr(float(x)) for x in point) for point in face]
                lines.append("f " + " ".join(str(count + 1 + i) for i in range(len(face))))
                count += len(face)
            (folder / f"{material}.obj").write_text("\n".join(lines) + "\n")
            text += f'[[mesh]]\nfile = "{material}.obj"\nmaterial = "{material}"\n'
        return text


def two_legs():
    """A corridor of two legs around a corner: the first along x, the second along z."""
    model, height = Model(), 2.5
    model.box("wall", (0, 0, 0), (6, height, 2), open_sides=("+x",))
    # The corner is open toward the first leg and the second.
    model.box("wall", (6, 0, 0), (8, height, 2), open_sides=("-x", "+z"))
    model.box("wall", (6, 0, 2), (8, height, 10), open_sides=("-z",))
    return model


def l_corridor(folder):
    """Meters in the second leg; the lamp is at the far end of the first."""
    model = two_legs()
    model.quad("lamp", (1, 2.49, 0.7), (0.6, 0, 0), (0, 0, 0.6))
    text = CAMERA.format(7, 1.6, 9, 7, 1.2, 2) + model.write(folder)
    text += MATTE.format("wall", 0.6) + LAMP.format(8)
    return text, [((7, 0.8, 5), UP), ((7, 0.8, 9), UP)], None


def bend(folder):
    """Meters at the corner itself: in the light of the lamp, in its half shadow and behind it."""
    model = two_legs()
    model.quad("lamp", (4, 2.49, 0.7), (0.6, 0, 0), (0, 0, 0.6))
    text = CAMERA.format(7, 1.6, 9, 7, 1.2, 2) + model.write(folder)
    text += MATTE.format("wall", 0.5) + LAMP.format(8)
    return text, [((7, 0.8, 1), UP), ((6.6, 0.8, 2.3), UP), ((6.2, 0.8, 3.5), UP)], None


def glass_ball(folder):
    """Meters on the floor below a ball of glass: in its caustic, at the edge of that, and beside it."""
    model = Model()
    model.box("wall", (-2, 0, -2), (2, 2.5, 2))
    model.ball("glass", (0, 0.6, 0), 0.3)
    model.quad("lamp", (-0.2, 2.49, -0.2), (0.4, 0, 0), (0, 0, 0.4))
    text = CAMERA.format(1.5, 1.5, 1.5, 0, 0.5, 0) + model.write(folder)
    text += MATTE.format("wall", 0.5) + LAMP.format(20) + '[materials.glass]\ntype = "dielectric"\nior = 1.5\n'
    places = [((0.03, 0.001, 0.02), UP), ((0.2, 0.001, 0), UP), ((0.6, 0.001, 0.2), UP)]
    return text, places, None


def window(folder):
    """Sun and clear sky through a window of thin glass: meters in the patch of the sun, beside it, and at the back."""
    model = Model()
    x, y, z = 5, 2.8, 4
    model.box("wall", (0, 0, 0), (x, y, z), open_sides=("-x",))
    # The wall at x = 0 around an opening from 0.9 to 2.3 m, 0.8 to 3.2 m
    for corner, height, width in [
        ((0, 0, 0), 0.9, z), ((0, 2.3, 0), y - 2.3, z), ((0, 0.9, 0), 1.4, 0.8), ((0, 0.9, 3.2), 1.4, 0.8)
    ]:
        model.quad("wall", corner, (0, height, 0), (0, 0, width))
    model.quad("glass", (0, 0.9, 0.8), (0, 1.4, 0), (0, 0, 2.4))
    text = CAMERA.format(4.5, 1.6, 0.5, 0, 1.4, 2) + model.write(folder)
    text += MATTE.format("wall", 0.5) + '[materials.glass]\ntype = "thin-dielectric"\nior = 1.5\n'
    text += "[sky]\nsun_direction = [-0.7, 0.6, 0.2]\n"
    # Light of the sun flies along (0.7, -0.6, -0.2): from the middle of the opening to about x = 1.9 on the floor
    return text, [((1.87, 0.001, 1.47), UP), ((1.5, 0.8, 3.6), UP), ((4.5, 0.8, 2), UP)], None


def room(folder):
    """A room with two lamps and a table: meters on the table, below it and in a corner."""
    model = Model()
    model.box("wall", (0, 0, 0), (5, 2.7, 4))
    model.solid("table", (2, 0.70, 1.4), (3.4, 0.74, 2.2))
    for x in (1.2, 3.4):
        model.quad("lamp", (x, 2.69, 1.8), (0.6, 0, 0), (0, 0, 0.3))
    text = CAMERA.format(0.5, 1.6, 0.5, 2.7, 0.7, 1.8) + model.write(folder)
    text += MATTE.format("wall", 0.6) + MATTE.format("table", 0.3) + LAMP.format(6)
    return text, [((2.7, 0.742, 1.8), UP), ((2.7, 0.1, 1.8), UP), ((4.9, 0.1, 3.9), UP)], None


def sky(folder):
    """The ground under an overcast sky: meters in the open, beside a wall, and in a narrow yard."""
    model = Model()
    model.quad("ground", (-20, 0, -20), (0, 0, 40), (40, 0, 0))
    model.solid("wall", (-4, 0, -1), (4, 5, 0))
    model.solid("wall", (-4, 0, 2), (4, 5, 3))
    text = CAMERA.format(10, 2, 10, 0, 1, 0) + model.write(folder)
    text += MATTE.format("ground", 0.3) + MATTE.format("wall", 0.6)
    text += "[sky]\nmodel = 'cie'\ncie_type = 1\ndiffuse_lx = 10000\n"
    return text, [((15, 0.01, 15), UP), ((0, 0.01, -1.3), UP), ((0, 0.01, 1), UP)], None


def globe(folder):
    """A lamp in a globe of glass: meters below, at the side on a wall, and in a corner of the room."""
    model = Model()
    model.box("wall", (-2, 0, -2), (2, 2.5, 2))
    model.ball("lamp", (0, 1.8, 0), 0.06)
    model.ball("glass", (0, 1.8, 0), 0.15)
    model.ball("glass", (0, 1.8, 0), 0.146, inward=True)
    text = CAMERA.format(1.5, 1.5, 1.5, 0, 1.5, 0) + model.write(folder)
    text += MATTE.format("wall", 0.5) + LAMP.format(60) + '[materials.glass]\ntype = "dielectric"\nior = 1.5\n'
    places = [((0.1, 0.001, 0.1), UP), ((-1.999, 1.5, 0.3), (1, 0, 0)), ((1.9, 0.001, 1.9), UP)]
    return text, places, None


SITUATIONS = {
    "l-corridor": l_corridor,
    "glass-ball": glass_ball,
    "window": window,
    "room": room,
    "bend": bend,
    "sky": sky,
    "globe": globe,
}
