"""`[materials.NAME]` of a surface, with the picture files that it takes."""

import os

import numpy as np

from . import images
from .values import Picture, VertexColor, is_constant, mean

# Roughness below which facets are a mirror to Blender.
SMOOTH = 1e-3
CLEAR_IOR = 1.0


class Store:
    """Pixels of images, read once, and picture files in a folder, written once."""

    def __init__(self, folder):
        self._folder = folder
        self._pixels = {}
        self._files = {}
        self._kept = []

    def pixels(self, image):
        if image.name_full not in self._pixels:
            self._pixels[image.name_full] = images.pixels(image)
        return self._pixels[image.name_full]

    def write(self, values, name):
        """A PNG file of bytes, by its name in the folder."""
        path = f"{name}-{len(self._kept)}.png"
        self._kept.append(path)
        images.write_png(os.path.join(self._folder, path), values)
        return path

    def color_file(self, picture):
        """A file of the picture's color, sRGB, and what to multiply it with."""
        image = picture.image
        if image is not None and picture.pixels.ndim == 3 and image.colorspace_settings.name == "sRGB":
            path = images.file_of(image)
            if path:
                return path, 1.0
        key = ("color", id(picture.pixels))
        if key not in self._files:
            scale = max(float(picture.pixels.max(initial=0)), 1.0)
            bytes_ = images.to_bytes(images.srgb(picture.pixels / scale))
            self._files[key] = (self.write(bytes_, "color"), scale, picture)
        return self._files[key][:2]

    def data_file(self, picture, name):
        """A file of the picture's numbers as they are."""
        image = picture.image
        if image is not None and picture.pixels.ndim == 3 and image.colorspace_settings.name == "Non-Color":
            path = images.file_of(image)
            if path:
                return path
        key = (name, id(picture.pixels))
        if key not in self._files:
            self._files[key] = (self.write(images.to_bytes(picture.pixels), name), picture)
        return self._files[key][0]


class Table:
    """The keys of a material, and what its meshes have to bring."""

    def __init__(self, look, store, remark):
        self.keys = {}
        self.place = None
        self.vertex_colors = None
        self.interior = look.interior
        self._store = store
        self._remark = remark
        self._add_kind(look)
        self._add_emission(look.emission)
        self._add_opacity(look)
        if look.normal is not None and look.kind != "clear":
            path = store.data_file(look.normal, "normals")
            self.keys["normal_texture"] = self._texture(look.normal, path)
            self.keys["normal_scale"] = float(np.clip(look.normal_scale, -100, 100))

    @property
    def emits(self):
        return "emission" in self.keys or "emission_texture" in self.keys

    def _add_kind(self, look):
        kind, rough = look.kind, look.roughness
        if kind == "diffuse" or kind == "principled" and look.ior <= 1 and self._is(look.metallic, 0):
            self.keys["type"] = "lambertian"
            self._add_albedo(look.color)
        elif kind == "glass":
            self._add_glass(look)
        elif kind == "sheet":
            self._add_sheet(look)
        elif kind == "clear":
            if look.is_clear() and look.interior is not None:
                self.keys["type"] = "boundary"
                return
            color = self._share(mean(look.color))
            self.keys |= {"type": "thin-dielectric", "ior": CLEAR_IOR, "transmittance": color}
            if look.is_clear():
                self.keys["opacity"] = 0.0
        elif kind == "gloss" and is_constant(look.color) and is_constant(rough):
            self._add_gloss(look)
        elif is_constant(look.color) and is_constant(rough) and self._is(look.metallic, 1):
            self.keys |= {"type": "metal", "reflectance": self._share(mean(look.color))}
            self._add_roughness(float(mean(rough)), look.once)
        else:
            self._add_principled(look)

    @staticmethod
    def _is(value, number):
        return is_constant(value) and float(mean(value)) == number

    def _add_glass(self, look):
        ior = float(np.clip(look.ior, 0.1, 10))
        if look.abbe is not None:
            ior = {"d": ior, "abbe": look.abbe}
        self.keys |= {"type": "dielectric", "ior": ior, "transmittance": self._share(mean(look.color))}
        self._add_roughness(float(mean(look.roughness)), look.once)

    def _add_sheet(self, look):
        colors = [look.color, look.transmitted]
        if all(is_constant(color) for color in colors):
            total = np.maximum(mean(colors[0]) + mean(colors[1]), 1)
            if (total > 1 + 1e-6).any():
                self._remark("reflects and transmits more light than it gets; scaled")
            colors = [mean(color) / total for color in colors]
        elif isinstance(look.transmitted, VertexColor):
            self._remark("transmits by a color attribute; took its middle")
            colors[1] = mean(look.transmitted)
        self.keys["type"] = "diffuse-transmission"
        for name, color in zip(("reflectance", "transmittance"), colors):
            self._add_color(name, color)

    def _add_gloss(self, look):
        color, roughness = self._share(mean(look.color)), float(mean(look.roughness))
        if roughness < SMOOTH:
            self.keys |= {"type": "mirror", "reflectance": color}
            return
        # A white metal reflects the same from all sides, and the tint makes it colored.
        self.keys |= {"type": "metal", "reflectance": 1.0}
        if look.once:
            self.keys["tint"] = color
        elif min(color) < 1:
            self._remark("light that facets scatter more than once is left out")
            self.keys["tint"] = color
        self._add_roughness(roughness, False)

    def _add_roughness(self, roughness, once):
        roughness = float(np.clip(roughness, 0, 1))
        if roughness >= SMOOTH:
            self.keys["roughness"] = roughness
            if once:
                self.keys["facets"] = "ggx"

    def _add_principled(self, look):
        self.keys |= {"type": "glossy", "ior": float(np.clip(look.ior, 0.1, 10))}
        self._add_albedo(look.color)
        rough, metallic = look.roughness, look.metallic
        for name, value in (("roughness", rough), ("metallic", metallic)):
            if isinstance(value, VertexColor):
                self._remark(f"{name} by a color attribute; took its middle")
        pictures = [value for value in (rough, metallic) if isinstance(value, Picture)]
        if not pictures:
            self.keys["roughness"] = float(np.clip(mean(rough), 0, 1))
            self.keys["metallic"] = float(np.clip(mean(metallic), 0, 1))
            return
        first = pictures[0]
        shape = first.pixels.shape[:2]
        packed = np.ones((*shape, 3), np.float32)
        for channel, value in ((1, rough), (2, metallic)):
            if not isinstance(value, Picture):
                packed[:, :, channel] = mean(value)
            elif value.pixels.shape[:2] == shape and value.place == first.place:
                packed[:, :, channel] = value.pixels
            else:
                self._remark("roughness and metal by pictures of different sizes or places; took the mean of one")
                packed[:, :, channel] = mean(value)
        path = self._store.write(images.to_bytes(packed), "roughness-metal")
        self.keys |= {"roughness": 1.0, "metallic": 1.0, "metallic_roughness_texture": self._texture(first, path)}

    def _share(self, color):
        if (color > 1 + 1e-6).any() or (color < 0).any():
            self._remark("reflects more light than it gets, or less than none; clamped")
        return [float(x) for x in np.clip(color, 0, 1)]

    def _add_albedo(self, color):
        self._add_color("albedo", color)

    def _add_color(self, key, color):
        if isinstance(color, VertexColor):
            self.vertex_colors = color.name
            self.keys[key] = self._share(color.factor)
        elif isinstance(color, Picture):
            path, scale = self._store.color_file(color)
            if scale > 1:
                self._remark("a picture reflects more light than it gets; clamped")
            self.keys |= {key: 1.0, f"{key}_texture": self._texture(color, path)}
        else:
            self.keys[key] = self._share(mean(color))

    def _add_emission(self, emission):
        if emission is None:
            return
        if isinstance(emission, Picture):
            path, scale = self._store.color_file(emission)
            self.keys |= {"emission": scale, "emission_texture": self._texture(emission, path)}
            return
        if isinstance(emission, VertexColor):
            self._remark("emission by a color attribute; took its middle")
        values = mean(emission)
        if (values < 0).any():
            self._remark("emits less than no light; took none")
        values = np.maximum(values, 0)
        if values.any():
            self.keys["emission"] = [float(x) for x in values]

    def _add_opacity(self, look):
        opacity = look.opacity
        if isinstance(opacity, VertexColor):
            self._remark("opacity by a color attribute; took its middle")
        if isinstance(opacity, Picture):
            if self.emits:
                self._remark("what shines has no holes")
                return
            path = self._store.write(images.to_bytes(opacity.pixels), "opacity")
            self.keys |= {"opacity": 1.0, "opacity_texture": self._texture(opacity, path)}
        elif float(mean(opacity)) < 1:
            if self.emits:
                self._remark("what shines is not transparent")
                return
            self.keys["opacity"] = float(np.clip(mean(opacity), 0, 1))

    def _texture(self, picture, path):
        if self.place is None:
            self.place = picture.place
        elif self.place != picture.place:
            self._remark("pictures at different places; took the coordinates of the first")
        table = {"file": path}
        if picture.wrap != "repeat":
            table["wrap"] = picture.wrap
        if picture.nearest:
            table["filter"] = "nearest"
        return table
