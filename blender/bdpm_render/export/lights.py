"""Blender's lights as bdpm has them, in W, W/sr and W/(m^2 sr): held against Cycles (docs/measurements/cycles.md).

Lights of a size become surfaces that shine, which the camera itself does not see unless Blender's is visible to it.
"""

import math

import bpy
import numpy as np

from ..nodes import arithmetic
from ..nodes.follow import Socket, output_of
from . import axes, ies, sphere

# Corners of a disc, and places that stand for a spot of a size.
DISC_CORNERS = 64
SPOT_PLACES = 24
# Suns of a larger radius, radians, are part of the environment, others points of it.
LEAST_SUN = math.radians(0.05)
NARROWEST_SPOT = math.radians(0.51)


class Lights:
    """What all lights become: tables of lights, shining meshes, and suns of a size."""

    def __init__(self, scene_writer, evaluator_of):
        self.tables = []
        self.suns = []
        self._writer = scene_writer
        self._ies_files = ies.Files(scene_writer.folder)
        self._evaluator_of = evaluator_of
        self._remark = scene_writer.remark

    def add(self, light_object, matrix):
        """A light at its place."""
        data = light_object.data
        strength, distribution = self._strength(light_object)
        self._note_ignored(light_object)
        if not strength.any():
            return
        matrix = np.array(matrix, np.float64)
        kind = {"POINT": self._point, "SPOT": self._spot, "SUN": self._sun, "AREA": self._area}[data.type]
        kind(light_object, strength, matrix, distribution)

    def _note_ignored(self, light_object):
        data = light_object.data
        cycles = getattr(data, "cycles", None)
        if not getattr(data, "use_shadow", True) or cycles is not None and not getattr(cycles, "cast_shadow", True):
            self._remark(light_object.name, "casts shadows all the same")
        for name in ("diffuse_factor", "specular_factor", "transmission_factor", "volume_factor"):
            if name != "volume_factor" and abs(getattr(data, name, 1.0) - 1) > 1e-6:
                self._remark(light_object.name, f"{name.replace('_', ' ')} is ignored")
        linking = getattr(light_object, "light_linking", None)
        if linking is not None and (linking.receiver_collection or linking.blocker_collection):
            self._remark(light_object.name, "light linking is ignored")

    def _strength(self, light_object):
        """Power by channel, W, or irradiance of suns, W/m^2; and the distribution of an IES texture, or None."""
        data = light_object.data
        color = np.array(data.color[:3], np.float64)
        if getattr(data, "use_temperature", False):
            own = getattr(data, "temperature_color", None)
            color *= np.array(own[:3]) if own is not None else arithmetic.blackbody(data.temperature)
        strength = data.energy * 2 ** getattr(data, "exposure", 0.0) * color
        distribution = None
        if data.use_nodes and data.node_tree:
            factor, distribution = self._nodes(light_object)
            strength = strength * factor
        if (strength < 0).any():
            self._remark(light_object.name, "takes light away; left out")
        return np.maximum(strength, 0), distribution

    def _nodes(self, light_object):
        """The factor that the nodes of a light have on its power, and the distribution of an IES texture, or None."""
        output = output_of(light_object.data.node_tree, {"OUTPUT_LIGHT"})
        source = Socket(output.inputs["Surface"]).source()[0] if output else None
        if source is None or source.node.type != "EMISSION":
            self._remark(light_object.name, "has nodes that are no emission; took its own color and strength")
            return np.ones(3), None
        evaluator = self._evaluator_of(light_object.name)
        color = evaluator.constant_color(source.input("Color"), "Color")
        strength = source.input("Strength")
        found = ies.find(strength, evaluator)
        if found is None:
            return color * evaluator.constant(strength, "Strength"), None
        distribution = found.distribution(lambda text: self._remark(light_object.name, text))
        return color * found.factor * (ies.UNREADABLE if distribution is None else 1), distribution

    def _normalized(self, light_object):
        return getattr(light_object.data, "normalize", True)

    def _point(self, light_object, power, matrix, distribution):
        if distribution is not None:
            self._ball(light_object, power, matrix, distribution)
            return
        radius = light_object.data.shadow_soft_size
        position = axes.vector(matrix[:3, 3])
        if radius <= 0:
            if self._normalized(light_object):
                self.tables.append({"type": "point", "position": position, "intensity": power / (4 * math.pi)})
            return
        area = 4 * math.pi * radius**2
        # Radiance that a sphere of that power has.
        radiance = power / (math.pi * area) if self._normalized(light_object) else power / (4 * math.pi)
        place = np.eye(4)
        place[:3, 3] = matrix[:3, 3]
        place[:3, :3] *= radius
        triangles, positions = sphere.icosphere()
        self._shine(light_object, radiance, place, triangles, positions)

    def _luminaire(self, light_object, power, matrix, distribution, opening, factor=None):
        """A light of an IES texture: ies.lm63 says what opening and factor are."""
        brightness = arithmetic.LUMINANCE @ power
        c0, _, up = ies.frame(matrix).T
        table = {
            "type": "luminaire",
            "file": self._ies_files.write(ies.lm63(distribution, matrix, opening, factor)),
            "position": axes.vector(matrix[:3, 3]),
            "direction": axes.vector(-up),
            "c0": axes.vector(c0),
            "scale": brightness * ies.SCALE_PER_WATT,
            "color": power / brightness,
        }
        if any(opening) and not light_object.visible_camera:
            table["hidden"] = True
        self.tables.append(table)

    def _ball(self, light_object, power, matrix, distribution, factor=None):
        """A point or spot of an IES texture: a sphere that has its intensity in every direction."""
        radius = light_object.data.shadow_soft_size
        if not self._normalized(light_object):
            power = power * math.pi * radius**2
        if power.any():
            self._luminaire(light_object, power, matrix, distribution, [-2 * radius] * 3, factor)

    def _half_angle(self, light_object):
        """Angle between the axis and the edge of a spot, radians."""
        size = light_object.data.spot_size
        half = min(max(0.5 * size, NARROWEST_SPOT), math.pi / 2)
        if half < 0.5 * size - 1e-6:
            self._remark(light_object.name, "its cone is no wider than a half space")
        return half

    def _sun(self, light_object, irradiance, matrix, distribution):
        if distribution is not None:
            irradiance = irradiance * distribution.at(np.array([0.0, 0, -1]))
        direction = -matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
        radius = 0.5 * light_object.data.angle
        if radius < LEAST_SUN:
            self.tables.append({"type": "sun", "direction": axes.vector(direction), "irradiance": irradiance})
            return
        if not self._normalized(light_object):
            irradiance = irradiance * math.pi * math.sin(min(radius, math.pi / 2)) ** 2
        self.suns.append((np.array(axes.vector(-direction)), radius, irradiance))
        if not light_object.visible_camera:
            self._remark(light_object.name, "is seen by the camera where nothing else is")

    def _area(self, light_object, power, matrix, distribution):
        data = light_object.data
        size_y = data.size_y if data.shape in {"RECTANGLE", "ELLIPSE"} else data.size
        half = np.array([0.5 * data.size, 0.5 * size_y])
        lengths = np.linalg.norm(matrix[:3, :2], axis=0)
        if data.shape in {"SQUARE", "RECTANGLE"}:
            outline = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
            area = 4 * np.prod(half * lengths)
        else:
            turns = np.arange(DISC_CORNERS) * (2 * math.pi / DISC_CORNERS)
            area = math.pi * np.prod(half * lengths)
            # The polygon of the disc's area.
            reach = math.sqrt(2 * math.pi / (DISC_CORNERS * math.sin(2 * math.pi / DISC_CORNERS)))
            outline = reach * np.column_stack([np.cos(turns), np.sin(turns)])
        if area <= 0:
            self._remark(light_object.name, "has no area; left out")
            return
        if getattr(data, "spread", math.pi) < math.pi - 1e-3:
            self._remark(light_object.name, "its spread is that of a diffuse surface")
        # Until 3.6 Cycles took 4 for pi here.
        pi = math.pi if bpy.app.version >= (4, 0) else 4.0
        if distribution is not None:
            own = power * math.pi / pi * (1 if self._normalized(light_object) else area)
            # The plane C0 is along -y. Negative sizes are those of ellipses.
            width, length = 2 * half * lengths * (1 if data.shape in {"SQUARE", "RECTANGLE"} else -1)
            self._luminaire(light_object, own, matrix, distribution, [width, length, 0], ies.OneSide())
            return
        radiance = power / (pi * area) if self._normalized(light_object) else power / pi
        corners = np.column_stack([outline * half, np.zeros(len(outline))])
        # It shines along -z: from the side from which the outline runs clockwise in x and y.
        triangles = [(0, k + 1, k) for k in range(1, len(outline) - 1)]
        self._shine(light_object, radiance, matrix, np.array(triangles), corners)

    def _shine(self, light_object, radiance, matrix, triangles, positions):
        keys = {"albedo": 0.0, "emission": radiance}
        if not light_object.visible_camera:
            keys["hidden"] = True
        self._writer.add_lamp(light_object.name, keys, matrix, triangles, positions)

    def _spot(self, light_object, power, matrix, distribution):
        """Smooth edges as a sum of quadratic ones, sizes as a sum of points: bdpm's spots are points, and their light
        falls off by t^2. Blender's 3 t^2 - 2 t^3 is the integral of 3 s^2 min(t/s, 1)^2 over s from 0 to 1."""
        data = light_object.data
        if distribution is not None:
            cone = ies.Cone(self._half_angle(light_object), data.spot_blend)
            self._ball(light_object, power, matrix, distribution, cone)
            return
        axis = -matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
        lengths = np.linalg.norm(matrix[:3, :3], axis=0)
        if lengths.max() > 1.001 * lengths.min():
            self._remark(light_object.name, "its cone is round, for all that its scale squeezes it")
        half = self._half_angle(light_object)
        radius = data.shadow_soft_size
        if bpy.app.version < (4, 0):
            self._remark(
                light_object.name, "its light does not grow with the cosine to its axis, as it does before 4.0"
            )
        intensity = power / (4 * math.pi)
        if radius > 0 and not self._normalized(light_object):
            intensity = power * radius**2 / 4
        if radius > 0:
            self._remark(light_object.name, f"its size is that of {SPOT_PLACES} points, which mirrors do not show")
        cosine = math.cos(half)
        count = SPOT_PLACES if radius > 0 else 8 if data.spot_blend > 1e-4 else 1
        shares = (np.arange(count) + 0.5) / count
        # The inverse of the integral of 3 s^2, in an order that has nothing to do with places.
        edges = np.cbrt(shares[np.argsort((np.arange(count) * 0.6180339887) % 1.0)])
        side = np.cross(axis, [0.0, 0, 1] if abs(axis[2]) < 0.9 else [1.0, 0, 0])
        side /= np.linalg.norm(side)
        other = np.cross(axis, side)
        for index, (share, edge) in enumerate(zip(shares, edges)):
            turn, reach = index * math.pi * (3 - math.sqrt(5)), radius * math.sqrt(share) if radius > 0 else 0.0
            position = matrix[:3, 3] + reach * (math.cos(turn) * side + math.sin(turn) * other)
            inner = math.degrees(math.acos(min(1.0, cosine + (1 - cosine) * data.spot_blend * edge)))
            outer = math.degrees(half)
            self.tables.append(
                {
                    "type": "spot",
                    "position": axes.vector(position),
                    "direction": axes.vector(axis),
                    "outer_deg": min(outer, 90.0),
                    "inner_deg": max(0.0, min(inner, outer - 1e-3)),
                    "intensity": intensity / count,
                }
            )
