"""Meshes as bdpm takes them: triangles of one material, with vertices that differ in nothing."""

import numpy as np


class Triangles:
    """A mesh of Blender as arrays, read once, and cut by material slots."""

    def __init__(self, mesh, needs=((), ())):
        """`needs`: names of texture coordinates and of color attributes; without a name, those to render with."""
        if hasattr(mesh, "calc_normals_split"):  # until 4.0
            mesh.calc_normals_split()
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        self.corners = _get(mesh.loop_triangles, "loops", np.int32, 3 * count).reshape(-1, 3)
        self.vertices = _get(mesh.loop_triangles, "vertices", np.int32, 3 * count).reshape(-1, 3)
        self.slots = _get(mesh.loop_triangles, "material_index", np.int32, count)
        self.positions = _get(mesh.vertices, "co", np.float32, 3 * len(mesh.vertices)).reshape(-1, 3)
        if not np.isfinite(self.positions).all():
            # Such vertices end up in one place, and their triangles without area are left out.
            self.is_broken = True
            self.positions = np.nan_to_num(self.positions, nan=0.0, posinf=0.0, neginf=0.0)
        else:
            self.is_broken = False
        self._normals = self._read_normals(mesh, count)
        uvs, colors = needs
        self._uvs = {name: _read_uvs(mesh, name) for name in uvs}
        self._colors = {name: _read_colors(mesh, name) for name in colors}

    def _read_normals(self, mesh, count):
        """One per corner, or None where all is flat."""
        if not count or not _get(mesh.loop_triangles, "use_smooth", bool, count).any():
            return None
        if hasattr(mesh, "corner_normals"):
            return _get(mesh.corner_normals, "vector", np.float32, 3 * len(mesh.loops)).reshape(-1, 3)
        return _get(mesh.loops, "normal", np.float32, 3 * len(mesh.loops)).reshape(-1, 3)

    def used_slots(self):
        return np.unique(self.slots).tolist()

    def part(self, slot, uv_name=None, uv_map=None, color_name=None, wants_uvs=False):
        """What `ply.write` takes, of the triangles of a slot; `uv_map` is a function of (n, 2) coordinates."""
        chosen = slice(None) if len(self.used_slots()) == 1 else self.slots == slot
        corners, vertices = self.corners[chosen], self.vertices[chosen]
        uvs = self._uvs.get(uv_name) if wants_uvs else None
        if uvs is not None and uv_map is not None:
            uvs = uv_map(uvs)
        colors = self._colors.get(color_name)
        own = {"normals": self._normals, "uvs": uvs, "colors": colors}
        own = {name: values[corners].reshape(-1, values.shape[1]) for name, values in own.items() if values is not None}
        index, first = _distinct(vertices.reshape(-1), list(own.values()))
        arrays = {name: values[first] for name, values in own.items()}
        positions = self.positions[vertices.reshape(-1)[first]]
        return {"triangles": index.reshape(-1, 3), "positions": positions, **arrays}

    def is_closed(self):
        """Whether each edge is met once from either side, and the front sides point outward: (closed, outward)."""
        edges = np.concatenate([self.vertices[:, [0, 1]], self.vertices[:, [1, 2]], self.vertices[:, [2, 0]]])
        edges = edges.astype(np.int64)
        there = edges[:, 0] << 32 | edges[:, 1]
        back = edges[:, 1] << 32 | edges[:, 0]
        there.sort()
        back.sort()
        closed = len(there) > 0 and np.array_equal(there, back) and (np.diff(there) > 0).all()
        a, b, c = (self.positions[self.vertices[:, k]].astype(np.float64) for k in range(3))
        volume = np.einsum("ij,ij->", a - a.mean(0), np.cross(b - a, c - a)) if closed else 0.0
        return bool(closed), volume >= 0


def _read_uvs(mesh, name):
    """Texture coordinates per corner of the map of this name, or of the one to render with; None without."""
    layers = mesh.uv_layers
    layer = layers.get(name) if name else next((one for one in layers if one.active_render), layers.active)
    if layer is None or not len(layer.data):
        return None
    return np.nan_to_num(_get(layer.data, "uv", np.float32, 2 * len(mesh.loops)).reshape(-1, 2))


def _read_colors(mesh, name):
    """Linear colors per corner of the attribute of this name, or of the one to render with; None without."""
    if name:
        attribute = mesh.attributes.get(name)
    else:
        every, index = mesh.color_attributes, mesh.color_attributes.render_color_index
        attribute = every[index] if 0 <= index < len(every) else None
    fields = {
        "FLOAT_COLOR": ("color", 4),
        "BYTE_COLOR": ("color", 4),
        "FLOAT_VECTOR": ("vector", 3),
        "FLOAT": ("value", 1),
    }
    if attribute is None or attribute.data_type not in fields or attribute.domain not in {"POINT", "CORNER"}:
        return None
    field, width = fields[attribute.data_type]
    values = _get(attribute.data, field, np.float32, width * len(attribute.data)).reshape(-1, width)
    values = np.nan_to_num(np.repeat(values, 3, axis=1) if width == 1 else values[:, :3])
    if attribute.domain == "POINT":
        values = values[_get(mesh.loops, "vertex_index", np.int32, len(mesh.loops))]
    return values


def _get(collection, field, dtype, count):
    values = np.empty(count, dtype)
    collection.foreach_get(field, values)
    return values


def _distinct(vertices, arrays):
    """Corners that are the same in all: the new index of each, and a corner for each index."""
    if not arrays:
        first = np.full(vertices.max(initial=-1) + 1, -1, np.int64)
        first[vertices[::-1]] = np.arange(len(vertices) - 1, -1, -1)
        used = first >= 0
        numbers = np.cumsum(used) - 1
        return numbers[vertices], first[used]
    with np.errstate(over="ignore"):
        key = vertices.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        for values in arrays:
            for column in np.ascontiguousarray(values.T, np.float32).view(np.uint32):
                key = (key ^ (key >> np.uint64(29)) ^ column) * np.uint64(0xBF58476D1CE4E5B9)
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    index = index.reshape(-1)
    same = (vertices[first][index] == vertices).all()
    same = same and all(np.array_equal(values[first][index], values) for values in arrays)
    if same:
        return index, first
    return np.arange(len(vertices)), np.arange(len(vertices))
