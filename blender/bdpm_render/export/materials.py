"""Materials as tables of a scene file, each with what its meshes have to bring."""

from dataclasses import replace

import numpy as np

from ..nodes.evaluate import Evaluator
from ..nodes.look import Look
from ..nodes.shaders import Shaders
from ..nodes.table import Table

# What Cycles shows where there is no material.
DEFAULT = Look(color=np.full(3, 0.8))

# Abbe numbers of clear media are from 15 to 100.
MIN_ABBE, MAX_ABBE = 5, 1000


class Materials:
    """Tables by name; a material of Blender is read once."""

    def __init__(self, store, remarks):
        self._store = store
        self._remarks = remarks
        self._tables = {}
        self.used = {}
        # Tables of media by name.
        self.media = {}

    def evaluator(self, where):
        """Of the nodes of something of this name."""
        return Evaluator(self._remark_node(where), self._store)

    def _remark_node(self, where):
        return lambda node, text: self._remarks.add(where, f"{node.label or node.name}: {text}")

    def table(self, material):
        """The table of a material of Blender, or of none."""
        key = material.name_full if material else None
        if key not in self._tables:
            where = f"Material {key}" if material else "Surfaces without material"
            remark = self._remark_node(where)
            look = self._look(material, remark)
            table = Table(look, self._store, lambda text: self._remarks.add(where, text))
            if table.interior is not None:
                self.media[key] = table.interior.keys()
                table.keys["interior"] = key
            self._tables[key] = table
        return self._tables[key]

    def _look(self, material, remark):
        if material is None:
            return DEFAULT
        if not material.use_nodes or material.node_tree is None:
            return Look(color=np.array(material.diffuse_color[:3], np.float64))
        look = Shaders(Evaluator(remark, self._store), remark).material(material.node_tree)
        return replace(look, abbe=self._abbe(material, look))

    def _abbe(self, material, look):
        """The Abbe number by the custom property `abbe` of the material, which Blender's nodes do not have."""
        abbe = material.get("abbe")
        if abbe is None:
            return None
        where = f"Material {material.name_full}"
        if look.kind != "glass":
            self._remarks.add(where, "its Abbe number (`abbe`) has no effect: it is not glass")
            return None
        if not isinstance(abbe, (int, float)) or not MIN_ABBE <= abbe <= MAX_ABBE:
            self._remarks.add(where, f"`abbe` is {abbe!r}, not a number from {MIN_ABBE} to {MAX_ABBE}; left out")
            return None
        return float(abbe)

    def name(self, material, is_hidden):
        """The name of its table in the scene file; hidden from the camera it is another."""
        name = material.name_full if material else "no material"
        if is_hidden:
            name += " (hidden)"
        keys = dict(self.table(material).keys)
        if is_hidden:
            keys["hidden"] = True
        return self.add(name, keys)

    def add(self, name, keys):
        """A table of its own under this name, or one like it."""
        free, number = name, 1
        while free in self.used and self.used[free] is not keys and not _same(self.used[free], keys):
            number += 1
            free = f"{name} {number}"
        self.used.setdefault(free, keys)
        return free


def _same(a, b):
    return a.keys() == b.keys() and all(np.array_equal(a[key], b[key]) for key in a)
