"""Volume nodes as homogeneous media of bdpm."""

from dataclasses import dataclass

import numpy as np

from .follow import Socket

# Largest magnitude of the mean cosine of scattering.
MOST_ANISOTROPY = 0.99


@dataclass(frozen=True, eq=False)
class Medium:
    """Coefficients per unit of length, RGB, and the mean cosine of the scattering angle."""

    absorption: np.ndarray
    scattering: np.ndarray
    anisotropy: float = 0.0

    def keys(self):
        """The keys of its table in a scene file."""
        keys = {"absorption": [float(x) for x in self.absorption]}
        if self.scattering.any():
            keys["scattering"] = [float(x) for x in self.scattering]
            if self.anisotropy:
                keys["asymmetry"] = float(np.clip(self.anisotropy, -MOST_ANISOTROPY, MOST_ANISOTROPY))
        return keys

    def is_empty(self):
        return not (self.absorption.any() or self.scattering.any())


EMPTY = Medium(np.zeros(3), np.zeros(3))


class Volumes:
    """Of one material; `remark(node, text)` is told what is approximated or ignored."""

    def __init__(self, evaluator, remark):
        self._values = evaluator
        self._remark = remark

    def medium(self, socket):
        """The medium of a socket, or None without one."""
        medium = self._medium(socket)
        return None if medium.is_empty() else medium

    def _medium(self, socket):
        source, _ = socket.source()
        if source is None:
            return EMPTY
        known = getattr(self, "node_" + source.node.type.lower(), None)
        if known is None:
            self._remark(source.node, "is a volume that is not known; ignored")
            return EMPTY
        return known(source)

    def _color(self, source, name):
        return np.clip(self._values.constant_color(source.input(name), name), 0, None)

    def _number(self, source, name):
        return self._values.constant(source.input(name), name)

    def node_volume_absorption(self, source):
        density = max(self._number(source, "Density"), 0)
        return Medium(density * np.clip(1 - self._color(source, "Color"), 0, None), np.zeros(3))

    def node_volume_scatter(self, source):
        density = max(self._number(source, "Density"), 0)
        phase = getattr(source.node, "phase", "HENYEY_GREENSTEIN")
        if phase != "HENYEY_GREENSTEIN":
            self._remark(source.node, f"the phase function {phase} is taken for that of Henyey and Greenstein")
        return Medium(np.zeros(3), density * self._color(source, "Color"), self._number(source, "Anisotropy"))

    def node_principled_volume(self, source):
        node = source.node
        # Attributes are those of grids, which meshes do not have.
        for name in ("Emission Strength", "Blackbody Intensity"):
            if name in node.inputs and self._number(source, name):
                self._remark(node, "the emission of volumes is ignored")
        density = max(self._number(source, "Density"), 0)
        color = self._color(source, "Color")
        # As Cycles has it.
        tint = np.clip(1 - np.sqrt(self._color(source, "Absorption Color")), 0, None)
        absorption = density * np.clip(1 - color, 0, None) * tint
        return Medium(absorption, density * color, self._number(source, "Anisotropy"))

    def node_add_shader(self, source):
        return self._sum(source, *(Socket(source.node.inputs[k], source.groups) for k in (0, 1)), (1.0, 1.0))

    def node_mix_shader(self, source):
        share = float(np.clip(self._values.constant(source.enabled("Fac"), "Fac"), 0, 1))
        return self._sum(source, *(Socket(source.node.inputs[k], source.groups) for k in (1, 2)), (1 - share, share))

    def _sum(self, source, first, second, weights):
        media = [self._medium(socket) for socket in (first, second)]
        absorption = sum(weight * medium.absorption for weight, medium in zip(weights, media, strict=True))
        parts = [weight * medium.scattering for weight, medium in zip(weights, media, strict=True)]
        amounts = [float(part.mean()) for part in parts]
        anisotropy = media[0].anisotropy
        if all(amounts) and media[0].anisotropy != media[1].anisotropy:
            self._remark(source.node, "two phase functions; took one of their mean anisotropy")
        if sum(amounts):
            anisotropy = sum(a * m.anisotropy for a, m in zip(amounts, media, strict=True)) / sum(amounts)
        return Medium(absorption, parts[0] + parts[1], anisotropy)
