"""Writes the evaluated scene as a scene file of bdpm: TOML, with meshes as binary PLY files and places as NumPy arrays.

Everything is in Blender's units; 1 Blender unit is 1 m to bdpm.
"""

import os
from dataclasses import dataclass

import numpy as np

from ..nodes.table import Store
from . import axes, camera, ply, toml, world
from .error import ExportError
from .lights import Lights
from .materials import Materials
from .meshes import Triangles
from .remarks import Remarks

SURFACES = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
# How far the back of a surface that shines on both sides is from its front, in sizes of the mesh.
BACK = 1e-5
# What is flatter loses the inverse of its matrix.
FLAT = 1e-12


@dataclass
class Exported:
    """A scene file, and what was approximated in it."""

    path: str
    remarks: list
    triangles: int


@dataclass
class Thing:
    """A mesh with its materials and all its places."""

    name: str
    mesh: Triangles
    materials: list
    is_hidden: bool
    places: list


class SceneWriter:
    """Puts a scene file together in a folder."""

    def __init__(self, folder):
        self.folder = folder
        self._remarks = Remarks()
        self.remark = self._remarks.add
        self.store = Store(folder)
        self.materials = Materials(self.store, self._remarks)
        self._meshes = []
        self._files = 0
        self._triangles = 0

    def write(self, depsgraph, has_stopped=lambda: False):
        """Writes all. Raises ExportError if there is nothing to render, and returns None if it was stopped."""
        head = toml.table("[camera]", camera.table(depsgraph, self.remark))
        lights = Lights(self, self.materials.evaluator)
        things = self._collect(depsgraph, lights, has_stopped)
        for thing in things:
            if has_stopped():
                return None
            self._add_thing(thing)
        scene_world = depsgraph.scene_eval.world
        environment = world.write(scene_world, lights.suns, self, has_stopped)
        if not self._triangles:
            raise ExportError("There is nothing to render: no visible object has faces. Add one, or show it in renders")
        shines = any(
            table.get("emission") is not None or "emission_texture" in table for table in self.materials.used.values()
        )
        if not (lights.tables or environment or shines):
            raise ExportError("There is no light: add a light, a world that is not black, or a material that emits")
        width, height = _resolution(depsgraph.scene_eval)
        filling = world.medium(scene_world, environment or lights.suns, self)
        if filling:
            head = f"medium = {toml.value(filling)}\n\n" + head
        parts = [head, toml.table("[render]", {"resolution": [width, height]})]
        parts += [toml.table(f"[media.{toml.value(name)}]", keys) for name, keys in self.materials.media.items()]
        parts += [toml.table("[[mesh]]", keys) for keys in self._meshes]
        used = self.materials.used.items()
        parts += [toml.table(f"[materials.{toml.value(name)}]", keys) for name, keys in used]
        parts += [toml.table("[[light]]", keys) for keys in lights.tables]
        if environment:
            parts.append(toml.table("[environment]", environment))
        path = os.path.join(self.folder, "scene.toml")
        with open(path, "w", encoding="utf-8") as file:
            file.write("\n".join(parts))
        return Exported(path, self._remarks.lines(), self._triangles)

    def _collect(self, depsgraph, lights, has_stopped):
        """Meshes by what they are, with all their places."""
        things, known = {}, {}
        for instance in depsgraph.object_instances:
            if not instance.show_self:
                continue
            thing_object = instance.object
            kind = thing_object.type
            if kind in SURFACES:
                key = (thing_object.data.as_pointer(), thing_object.name_full)
                thing = known.get(key)
                if thing is None:
                    thing = known[key] = self._thing(things, thing_object)
                thing.places.append([value for row in instance.matrix_world for value in row])
                if len(thing.places) % 4096 == 0 and has_stopped():
                    break
            elif kind == "LIGHT":
                lights.add(thing_object, instance.matrix_world)
            elif kind not in {"CAMERA", "EMPTY", "ARMATURE", "LATTICE", "SPEAKER", "LIGHT_PROBE"}:
                self.remark(thing_object.name, f"objects of type {kind.lower()} are left out")
            self._note_particles(thing_object)
        return list(things.values())

    def _note_particles(self, thing_object):
        for system in getattr(thing_object, "particle_systems", ()):
            if system.settings.type == "HAIR" and system.settings.render_type == "PATH":
                self.remark(thing_object.name, "hair is left out")

    def _thing(self, things, thing_object):
        """The thing of an object: objects of one mesh, the same materials and visibility share it."""
        data = thing_object.data
        materials = [slot.material for slot in thing_object.material_slots] or list(getattr(data, "materials", ()))
        hidden = not thing_object.visible_camera
        names = tuple(material.name_full if material else None for material in materials)
        # Other kinds of data, and meshes that are made on the fly, have no lasting address of their geometry.
        key = (data.as_pointer() if thing_object.type == "MESH" else thing_object.name_full, names, hidden)
        if key in things:
            return things[key]
        if getattr(thing_object, "is_holdout", False):
            self.remark(thing_object.name, "holdouts are not known; it is seen")
        for ray in ("diffuse", "glossy", "transmission", "shadow"):
            if not getattr(thing_object, f"visible_{ray}", True):
                self.remark(thing_object.name, f"is visible to {ray} rays all the same")
        is_mesh = thing_object.type == "MESH"
        mesh = data if is_mesh else thing_object.to_mesh()
        triangles = Triangles(mesh, self._needs(mesh, materials)) if mesh else None
        if mesh and not is_mesh:
            thing_object.to_mesh_clear()
        if triangles is not None and triangles.is_broken:
            self.remark(thing_object.name, "has vertices that are no numbers; they became 0")
        things[key] = Thing(thing_object.name, triangles, materials, hidden, [])
        return things[key]

    def _needs(self, mesh, materials):
        """Names of the texture coordinates and of the color attributes that its materials take."""
        tables = [self.materials.table(material) for material in materials or [None]]
        uvs = {table.place.uv for table in tables if table.place is not None}
        return uvs, {table.vertex_colors for table in tables if table.vertex_colors is not None}

    def _add_thing(self, thing):
        if thing.mesh is None or not len(thing.mesh.corners):
            return
        places = np.array(thing.places, np.float64).reshape(-1, 4, 4)
        places = axes.TO_SCENE @ places
        finite = np.isfinite(places).all(axis=(1, 2))
        sizes = np.abs(places[:, :3, :3]).max(axis=(1, 2))
        safe = np.where(finite[:, None, None], places[:, :3, :3], 0.0)
        flat = np.abs(np.linalg.det(safe)) <= FLAT * np.where(finite, sizes, 1.0) ** 3
        if not finite.all():
            self.remark(thing.name, "has a place that is no number; left out there")
        squashed = places[finite & flat & (sizes > 0)]
        places = places[finite & ~flat]
        for slot in thing.mesh.used_slots():
            self._add_part(thing, slot, places, squashed)

    def _add_part(self, thing, slot, places, squashed):
        # Slots that are not there show the last one.
        materials = thing.materials
        material = materials[min(slot, len(materials) - 1)] if materials else None
        table = self.materials.table(material)
        name = self.materials.name(material, thing.is_hidden)
        place = table.place
        part = thing.mesh.part(
            slot,
            uv_name=place.uv if place else None,
            uv_map=place.apply if place and not place.is_plain() else None,
            color_name=table.vertex_colors,
            wants_uvs=place is not None,
        )
        if place is not None and "uvs" not in part:
            self.remark(thing.name, f"has no texture coordinates {place.uv}".rstrip() + "; pictures show their corner")
        if table.vertex_colors is not None and "colors" not in part:
            self.remark(
                thing.name, f"has no color attribute {table.vertex_colors}".rstrip() + " that is known; took white"
            )
        for one in self._sides(part, table, thing):
            if len(places):
                self._place(one, name, places)
            for matrix in squashed:
                # No matrix leads back from there: the mesh is written where it is, and flat.
                moved = one["positions"] @ matrix[:3, :3].T + matrix[:3, 3]
                rest = {key: value for key, value in one.items() if key not in {"positions", "normals"}}
                self._place({**rest, "positions": moved}, name, np.eye(4)[None])

    def _sides(self, part, table, thing):
        """What shines does so on both sides in Blender, and on the front alone here."""
        if not table.emits:
            return [part]
        closed, outward = thing.mesh.is_closed()
        back = {**part, "triangles": part["triangles"][:, ::-1]}
        if closed:
            return [part if outward else back]
        corners = part["positions"][part["triangles"]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        size = np.ptp(part["positions"], axis=0).max()
        flat = part["triangles"].reshape(-1)
        back = {key: value[flat] for key, value in part.items() if key != "triangles"}
        back["positions"] = (corners - BACK * size * normals[:, None]).reshape(-1, 3)
        back["triangles"] = np.arange(len(flat)).reshape(-1, 3)[:, ::-1]
        return [part, back]

    def _place(self, part, material, places):
        file = f"mesh{self._files}.ply"
        ply.write(os.path.join(self.folder, file), **part)
        keys = {"file": file, "material": material}
        if len(places) == 1:
            keys["matrix"] = places[0]
        else:
            keys["places"] = f"places{self._files}.npy"
            ply.write_places(os.path.join(self.folder, keys["places"]), places[:, :3])
        self._files += 1
        self._triangles += len(part["triangles"]) * len(places)
        self._meshes.append(keys)

    def add_lamp(self, name, keys, matrix, triangles, positions):
        """A mesh that shines, with a material of its own."""
        material = self.materials.add(f"Light {name}", keys)
        self._place({"triangles": triangles, "positions": positions}, material, axes.matrix(matrix)[None])
        self._triangles -= len(triangles)


def _resolution(scene):
    left, bottom, right, top = camera.region(scene)
    return right - left, top - bottom
