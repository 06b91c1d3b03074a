"""Shader nodes as surfaces of bdpm."""

import math
from dataclasses import replace

import numpy as np

from . import look as looks
from .follow import Socket, output_of
from .look import BLACK, EMPTY, WHITE, Look
from .values import Picture, combine, is_constant, mean
from .volumes import Volumes

# A coat of at least this weight becomes a full one.
COAT_WEIGHT = 0.5
HALF = 0.5
# Rough glass loses a percent of the light beyond this.
LOSSLESS = 0.2


class Shaders:
    """Of one material; `remark(node, text)` is told what is approximated or ignored."""

    def __init__(self, evaluator, remark):
        self._values = evaluator
        self._remark = remark

    def material(self, tree):
        """The surface of a material's nodes."""
        output = output_of(tree, {"OUTPUT_MATERIAL"})
        if output is None:
            return EMPTY
        if Socket(output.inputs["Displacement"]).source()[0] is not None:
            self._remark(output, "displacement is ignored")
        surface = Socket(output.inputs["Surface"])
        interior = Volumes(self._values, self._remark).medium(Socket(output.inputs["Volume"]))
        if interior is None:
            return self._shader(surface)
        if surface.source()[0] is None:
            return Look("clear", WHITE, interior=interior)
        look = self._shader(surface)
        if look.kind not in {"glass", "clear"}:
            self._remark(output, "the volume of an opaque surface is ignored")
            return look
        return replace(look, interior=interior)

    def _shader(self, socket):
        source, _ = socket.source()
        if source is None:
            return EMPTY
        known = getattr(self, "node_" + source.node.type.lower(), None)
        if known is None:
            self._remark(source.node, "is a shader that is not known; took gray")
            return Look(color=np.full(3, HALF))
        return known(source)

    def _color(self, source, name):
        return self._values.color(source.input(name))

    def _constant(self, source, *names, default=0.0):
        """The number of the first input of these names that there is, for names changed."""
        for name in names:
            if name in source.node.inputs:
                return self._values.constant(source.input(name), name)
        return default

    def _normal(self, source, name="Normal"):
        """The keys of a map of normals."""
        if name not in source.node.inputs:
            return {}
        from_, _ = source.input(name).source()
        if from_ is None:
            return {}
        node = from_.node
        if node.type == "NORMAL_MAP":
            if node.space != "TANGENT":
                self._remark(node, f"normals in {node.space.lower()} space are not known; left out")
                return {}
            picture = self._values.color(from_.input("Color"))
            if not isinstance(picture, Picture):
                return {}
            if node.uv_map:
                picture = replace(picture, place=replace(picture.place, uv=node.uv_map))
            scale = self._values.constant(from_.input("Strength"), "Strength")
            return {"normal": picture, "normal_scale": scale}
        self._remark(node, "bends normals in a way that is not known; left out")
        return {}

    def node_bsdf_diffuse(self, source):
        if self._constant(source, "Roughness") > 0:
            self._remark(source.node, "roughness of diffuse surfaces is ignored")
        return Look(color=self._color(source, "Color"), **self._normal(source))

    def node_bsdf_glossy(self, source):
        if self._constant(source, "Anisotropy"):
            self._remark(source.node, "anisotropy is ignored")
        roughness = self._values.number(source.input("Roughness"))
        smooth = source.node.distribution == "SHARP"
        once = source.node.distribution != "MULTI_GGX"
        return Look(
            "gloss",
            self._color(source, "Color"),
            roughness=np.float64(0) if smooth else roughness,
            metallic=np.float64(1),
            once=once,
            **self._normal(source),
        )

    node_bsdf_anisotropic = node_bsdf_metallic = node_bsdf_glossy

    def node_bsdf_glass(self, source):
        smooth = source.node.distribution == "SHARP"
        roughness = 0.0 if smooth else self._constant(source, "Roughness")
        ior = self._constant(source, "IOR")
        color = self._values.constant_color(source.input("Color"), "Color")
        if (color < 0.999).any():
            self._remark(source.node, "its color tints light that passes, not what it reflects")
        once = source.node.distribution != "MULTI_GGX"
        self._note_lost(source.node, roughness, once)
        return Look("glass", color, roughness=np.float64(roughness), ior=ior, once=once, **self._normal(source))

    def _note_lost(self, node, roughness, once):
        if roughness > LOSSLESS and not once:
            self._remark(node, "light that facets of rough glass scatter more than once is lost")

    def node_bsdf_refraction(self, source):
        self._remark(source.node, "reflects as well, as glass does")
        return self.node_bsdf_glass(source)

    def node_bsdf_transparent(self, source):
        color = self._values.constant_color(source.input("Color"), "Color")
        return Look("clear", color)

    def node_bsdf_translucent(self, source):
        return Look("sheet", BLACK, transmitted=self._color(source, "Color"), **self._normal(source))

    def node_subsurface_scattering(self, source):
        self._remark(source.node, "light does not go below the surface; took a diffuse one")
        return Look(color=self._color(source, "Color"), **self._normal(source))

    def node_bsdf_velvet(self, source):
        self._remark(source.node, "took a diffuse surface")
        return Look(color=self._color(source, "Color"), **self._normal(source))

    node_bsdf_sheen = node_bsdf_toon = node_bsdf_velvet

    def node_holdout(self, source):
        self._remark(source.node, "holdouts are not known; took black")
        return EMPTY

    def node_emission(self, source):
        emission = combine(
            lambda color, strength: color * strength,
            [self._color(source, "Color"), self._values.number(source.input("Strength"))],
            lambda text: self._remark(source.node, text),
        )
        return replace(EMPTY, emission=emission)

    def node_background(self, source):
        return self.node_emission(source)

    def node_mix_shader(self, source):
        def remark(text):
            self._remark(source.node, text)

        first, second = (Socket(source.node.inputs[k], source.groups) for k in (1, 2))
        share = source.enabled("Fac")
        from_, _ = share.source()
        a, b = self._shader(first), self._shader(second)
        if from_ is not None and from_.node.type in {"FRESNEL", "LAYER_WEIGHT"}:
            varnished = self._varnish(from_, a, b, source.node)
            if varnished:
                return varnished
        share = self._values.number(share)
        share = combine(lambda s: np.clip(s, 0, 1), [share], remark)
        return looks.mix(share, a, b, remark)

    def _varnish(self, weight, base, gloss, node):
        """A mixture by Fresnel's formula, of which a gloss comes on top of something diffuse."""
        if base.kind != "diffuse" or gloss.kind != "gloss" or not is_constant(gloss.roughness):
            return None
        if "IOR" in weight.node.inputs:
            ior = self._values.constant(weight.input("IOR"), "IOR")
        else:
            blend = min(self._values.constant(weight.input("Blend"), "Blend"), 0.99)
            ior = 1 / (1 - blend) if weight.output.name == "Fresnel" else looks.GLASS_IOR
        self._remark(node, "gloss by angle over a diffuse base; took a surface of that refractive index")
        return replace(base, kind="principled", roughness=gloss.roughness, ior=max(ior, 1.0001))

    def node_add_shader(self, source):
        first, second = (self._shader(Socket(source.node.inputs[k], source.groups)) for k in (0, 1))
        return looks.add(first, second, lambda text: self._remark(source.node, text))

    def node_bsdf_principled(self, source):
        node = source.node
        for names, what in (
            (("Subsurface", "Subsurface Weight"), "subsurface scattering is ignored: the surface is diffuse"),
            (("Sheen", "Sheen Weight"), "sheen is ignored"),
            (("Anisotropic",), "anisotropy is ignored"),
            (("Thin Film Thickness",), "thin films are ignored"),
            (("Diffuse Roughness",), "roughness of diffuse surfaces is ignored"),
        ):
            if self._constant(source, *names):
                self._remark(node, what)
        base = self._principled_base(source)
        alpha = self._values.number(source.input("Alpha"))
        return replace(base, emission=self._principled_emission(source), opacity=alpha)

    def _principled_emission(self, source):
        name = "Emission Color" if "Emission Color" in source.node.inputs else "Emission"
        color, strength = self._color(source, name), self._values.number(source.input("Emission Strength"))
        if is_constant(strength) and not mean(strength).any() or is_constant(color) and not mean(color).any():
            return None
        return combine(lambda c, s: c * s, [color, strength], lambda text: self._remark(source.node, text))

    def _principled_base(self, source):
        node, values = source.node, self._values
        color = self._color(source, "Base Color")
        roughness, metallic = (values.number(source.input(name)) for name in ("Roughness", "Metallic"))
        normal = self._normal(source)
        transmission = self._constant(source, "Transmission", "Transmission Weight")
        is_new = "Specular IOR Level" in node.inputs
        ior = self._constant(source, "IOR")
        once = node.distribution == "GGX"
        if 0 < transmission < 1:
            self._remark(node, f"a transmission of {transmission:g} is rounded")
        is_metal = float(mean(metallic)) >= HALF
        if transmission >= HALF and not is_metal:
            color = values.constant_color(source.input("Base Color"), "Base Color")
            rough = values.constant(source.input("Roughness"), "Roughness")
            tint = np.sqrt(np.clip(color, 0, 1)) if is_new else color
            if self._constant(source, "Transmission Roughness"):
                self._remark(node, "Transmission Roughness is ignored")
            self._note_lost(node, rough, once)
            return Look("glass", tint, roughness=np.float64(rough), ior=ior, once=once, **normal)
        coat = self._constant(source, "Clearcoat", "Coat Weight")
        coat_roughness = self._constant(source, "Clearcoat Roughness", "Coat Roughness")
        if coat > 0:
            if coat >= COAT_WEIGHT and not is_metal:
                # Facets of the coat, which keep the energy as the layers of Cycles do: cycles.md has the errors.
                self._remark(node, "a coat: took a full coat over a diffuse base")
                coat_ior = self._constant(source, "Coat IOR", default=1.5)
                return Look(
                    "principled", color, roughness=np.float64(coat_roughness), ior=coat_ior, once=once, **normal
                )
            self._remark(node, "a thin coat, or one on metal, is ignored")
        ior = self._specular_ior(source, ior, is_new)
        return Look("principled", color, roughness=roughness, metallic=metallic, ior=ior, once=once, **normal)

    def _specular_ior(self, source, ior, is_new):
        """The refractive index that reflects as much at normal incidence."""
        if is_new:
            level = self._constant(source, "Specular IOR Level")
            normal = ((ior - 1) / (ior + 1)) ** 2 * 2 * level
            tint = self._values.constant_color(source.input("Specular Tint"), "Specular Tint")
            if (np.abs(tint - 1) > 1e-3).any():
                self._remark(source.node, "Specular Tint is ignored")
        else:
            normal = 0.08 * self._constant(source, "Specular")
            if self._constant(source, "Specular Tint"):
                self._remark(source.node, "Specular Tint is ignored")
        root = math.sqrt(min(max(normal, 0.0), 0.66))
        return min((1 + root) / (1 - root), 10.0)
