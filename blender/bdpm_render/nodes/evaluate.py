"""Nodes that give colors and numbers, evaluated: constants folded, pictures computed pixel by pixel."""

import math

import numpy as np

from . import arithmetic
from .follow import Socket
from .values import Picture, Place, VertexColor, color, combine, gray, is_constant, mean

WRAPS = {"REPEAT": "repeat", "EXTEND": "clamp", "MIRROR": "mirror", "CLIP": "clamp"}
# What stands for patterns that are not computed.
MIDDLE = 0.5
# As the ray of a camera sees it.
LIGHT_PATH = {"Is Camera Ray": 1.0, "Is Singular Ray": 0.0, "Transparent Depth": 0.0}


class Evaluator:
    """Of the nodes of one tree; `remark(node, text)` is told what is approximated or ignored."""

    def __init__(self, remark, store):
        self._remark = remark
        self._store = store
        self._known = {}

    def color(self, socket):
        return color(self._value(socket))

    def number(self, socket):
        return gray(self._value(socket))

    def constant(self, socket, what):
        """A number; where it varies its mean, which is told."""
        value = self.number(socket)
        if not is_constant(value):
            self._remark(socket.socket.node, f"{what} varies; took its mean")
        return float(mean(value))

    def constant_color(self, socket, what):
        value = self.color(socket)
        if not is_constant(value):
            self._remark(socket.socket.node, f"{what} varies; took its mean")
        return mean(value)

    def is_linked(self, socket):
        return socket.source()[0] is not None

    def _value(self, socket):
        source, own = socket.source()
        if source is None:
            return _default(own)
        key = (source.node.as_pointer(), source.output.identifier, tuple(g.as_pointer() for g in source.groups))
        if key not in self._known:
            self._known[key] = np.float64(MIDDLE)  # a link that leads back to itself
            self._known[key] = self._of(source)
        return self._known[key]

    def _of(self, source):
        node = source.node
        known = getattr(self, "node_" + node.type.lower(), None)
        if known:
            return known(source)
        folded = arithmetic.NODES.get(node.type)
        if folded:
            function, inputs = folded(node)
            values = [self._typed(source, name, kind) for name, kind in inputs]
            return combine(function, values, lambda text: self._remark(node, text))
        self._remark(node, "is not known; took a constant")
        return np.float64(MIDDLE)

    def _typed(self, source, name, kind):
        socket = source.enabled(name) if isinstance(name, str) else Socket(source.node.inputs[name], source.groups)
        value = self._value(socket)
        return color(value) if kind == "color" else gray(value) if kind == "number" else value

    def node_value(self, source):
        return _plain(source.output.default_value)

    node_rgb = node_value

    def node_separate_color(self, source):
        node = source.node
        index = list(node.outputs).index(source.output)
        if getattr(node, "mode", "RGB") != "RGB":
            self._remark(node, f"mode {node.mode} is not known; took red, green and blue")
        parts = self._typed(source, 0, "color")
        return combine(lambda a: a[..., index], [parts], lambda text: self._remark(node, text))

    node_seprgb = node_sepxyz = node_separate_color

    def node_tex_image(self, source):
        node = source.node
        if node.image is None:
            self._remark(node, "has no image; took Blender's pink")
            return np.array([1.0, 0.0, 1.0])
        if node.image.source in {"TILED", "SEQUENCE", "MOVIE"}:
            self._remark(node, f"is of a kind ({node.image.source.lower()}) of which only one picture is taken")
        if node.projection != "FLAT":
            self._remark(node, f"projection {node.projection.lower()} is not known; took texture coordinates")
        if node.extension == "CLIP":
            self._remark(node, "extension Clip is not known; took Extend")
        pixels = self._store.pixels(node.image)
        if pixels is None:
            self._remark(
                node, f"the image {node.image.name} has no pixels, or its file is missing; took Blender's pink"
            )
            return np.array([1.0, 0.0, 1.0])
        is_alpha = source.output.name == "Alpha"
        own = pixels[:, :, 3] if is_alpha else pixels[:, :, :3]
        place = self._place(source, "Vector")
        nearest = node.interpolation == "Closest"
        return Picture(own, place, WRAPS.get(node.extension, "repeat"), nearest, node.image)

    def _place(self, source, name):
        """Where the texture coordinates of an input come from."""
        from_, _ = source.input(name).source()
        if from_ is None:
            return Place()
        node = from_.node
        if node.type == "UVMAP":
            return Place(node.uv_map)
        if node.type == "TEX_COORD" and from_.output.name == "UV":
            return Place()
        if node.type == "ATTRIBUTE" and node.attribute_type == "GEOMETRY":
            return Place(node.attribute_name)
        if node.type == "MAPPING":
            return self._place(from_, "Vector").after(self._mapping_rows(from_))
        self._remark(node, "gives coordinates other than a UV map; took the UV map")
        return Place()

    def _mapping_rows(self, source):
        node = source.node

        def vector(name, default):
            if not source.has(name):
                return np.full(3, default)
            value = self._value(source.input(name))
            if not is_constant(value):
                self._remark(node, f"{name} varies; took its mean")
            return np.broadcast_to(mean(value), 3)

        move, turn, scale = vector("Location", 0.0), vector("Rotation", 0.0), vector("Scale", 1.0)
        if abs(turn[0]) > 1e-6 or abs(turn[1]) > 1e-6:
            self._remark(node, "turns pictures about x or y; took the turn about z alone")
        c, s = math.cos(turn[2]), math.sin(turn[2])
        rotation = np.array([[c, -s], [s, c]])
        if node.vector_type == "TEXTURE":
            safe = np.where(scale[:2] == 0, 1.0, scale[:2])
            matrix = np.diag(1 / safe) @ rotation.T
            return np.column_stack([matrix, -matrix @ move[:2]])
        matrix = rotation @ np.diag(scale[:2])
        offset = move[:2] if node.vector_type == "POINT" else np.zeros(2)
        return np.column_stack([matrix, offset])

    def node_vertex_color(self, source):
        if source.output.name == "Alpha":
            self._remark(source.node, "alpha of a color attribute is ignored")
            return np.float64(1.0)
        return VertexColor(source.node.layer_name, np.ones(3))

    def node_attribute(self, source):
        node = source.node
        if node.attribute_type != "GEOMETRY" or source.output.name not in {"Color", "Vector", "Fac"}:
            self._remark(node, "an attribute other than a color of the geometry; took a constant")
            return np.float64(MIDDLE)
        return VertexColor(node.attribute_name, np.ones(3))

    def node_light_path(self, source):
        self._remark(source.node, "took what a ray of the camera sees")
        return np.float64(LIGHT_PATH.get(source.output.name, 0.0))

    def node_new_geometry(self, source):
        if source.output.name == "Backfacing":
            self._remark(source.node, "Backfacing: took the front for both sides")
            return np.float64(0.0)
        self._remark(source.node, f"{source.output.name} varies over surfaces; took a constant")
        return np.float64(MIDDLE)

    def node_fresnel(self, source):
        ior = self.constant(source.input("IOR"), "IOR")
        self._remark(source.node, "took its value for light that meets the surface straight")
        return np.float64(((ior - 1) / (ior + 1)) ** 2)

    def node_tex_checker(self, source):
        self._remark(source.node, "the pattern is not known; took the mean of its colors")
        if source.output.name == "Fac":
            return np.float64(0.5)
        return 0.5 * (mean(self.color(source.input("Color1"))) + mean(self.color(source.input("Color2"))))


def _default(socket):
    if socket is None or not hasattr(socket, "default_value"):
        return np.float64(0.0)
    return _plain(socket.default_value)


def _plain(value):
    if isinstance(value, (int, float, bool)):
        return np.float64(value)
    return np.array(value[:3], np.float64)
