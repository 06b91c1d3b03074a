#!/usr/bin/env python3
"""IFC models as a scene of bdpm: surfaces by material, luminaires by photometric file, meters by room.

    python3 -m venv VENV && VENV/bin/pip install ifcopenshell
    VENV/bin/python scripts/ifc_scene.py BUILDING.ifc [ELECTRICAL.ifc ...] OUT --ies panel.ies --ies Downlight=spot.ldt
    bdpm info OUT && bdpm measure OUT --report OUT/report.html

Writes OUT/scene.toml and OUT/building.obj. Several models are parts of one building, such as its architecture and its
electrical installation. What it does with their elements:

- Geometry in world coordinates, meters, +y up. Materials have the names and colors of the styles, and are diffuse.
  Styles with a transparency of at least .3 are clear glass: panes of a window keep their thickness.
- An IfcLightFixture, in IFC 2x3 an element of an IfcLightFixtureType, becomes a luminaire in the middle of the bottom of its body, which shines down. Its file is that of
  --ies NAME=FILE whose NAME is a part of the name of the fixture or of its type, else that of --ies FILE. Its body is
  left out, since it would block the light.
- An IfcSpace becomes a grid of meters --height above its floor with --border around it, whose points are those of
  EN 12464-1. --required-mean, --required-uniformity and --maintenance-factor are written into each grid.
- Openings, annotations and grids are left out.
"""

import argparse
import pathlib
import re
import shutil
import sys

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.util.element

LEFT_OUT = ("IfcOpeningElement", "IfcSpace", "IfcAnnotation", "IfcGrid", "IfcVirtualElement")
GLASS = 0.3
# Reflectances of materials without a color, and the range of those with one.
DEFAULT, DARKEST, BRIGHTEST = 0.5, 0.03, 0.85
# Least side of a grid of meters, m.
LEAST = 0.3


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", type=pathlib.Path, nargs="+", metavar="BUILDING.ifc")
    parser.add_argument("out", type=pathlib.Path, metavar="OUT")
    parser.add_argument("--ies", action="append", default=[], metavar="[NAME=]FILE")
    parser.add_argument("--height", type=float, default=0.75)
    parser.add_argument("--border", type=float, default=0.5)
    for name in ("required-mean", "required-uniformity", "maintenance-factor"):
        parser.add_argument(f"--{name}", type=float)
    return parser.parse_args()


def is_luminaire(element):
    kind = ifcopenshell.util.element.get_type(element)
    return element.is_a("IfcLightFixture") or (kind is not None and kind.is_a("IfcLightFixtureType"))


def shapes(model, settings, chosen):
    """Elements with their geometry, in world coordinates."""
    for element in model.by_type("IfcProduct"):
        if element.Representation is None or not chosen(element):
            continue
        try:
            yield element, ifcopenshell.geom.create_shape(settings, element).geometry
        except RuntimeError as error:
            print(f"note: {element.is_a()} {element.Name}: {error}", file=sys.stderr)


def ours(x, y, z):
    """Coordinates with +y up."""
    return x, z, -y


def corners(geometry):
    numbers = geometry.verts
    return [ours(*numbers[index : index + 3]) for index in range(0, len(numbers), 3)]


class Materials:
    """Names of scene files for the styles of the model."""

    def __init__(self):
        self.keys = {}

    def label(self, model, style):
        """The name of the surface style that a style of the geometry comes from."""
        number = style.instance_id()
        if number <= 0:
            return style.name
        entity = model.by_id(number)
        owners = [entity] if entity.is_a("IfcSurfaceStyle") else model.get_inverse(entity)
        names = [own.Name for own in owners if own.is_a("IfcSurfaceStyle") or own.is_a("IfcMaterial")]
        return next(filter(None, names), None) or style.name

    def name(self, model, style):
        label = self.label(model, style) or "surface"
        own = re.sub(r"[^A-Za-z0-9_-]+", "_", label).strip("_") or "surface"
        if own not in self.keys:
            color = style.diffuse
            rgb = [getattr(color, channel)() for channel in "rgb"] if color is not None else [DEFAULT] * 3
            rgb = [min(max(channel, DARKEST), BRIGHTEST) if channel >= 0 else DEFAULT for channel in rgb]
            transparency = style.transparency
            is_glass = transparency == transparency and transparency >= GLASS
            keys = 'type = "dielectric"\nior = 1.52\n' if is_glass else f"albedo = {[round(own, 4) for own in rgb]}\n"
            self.keys[own] = keys
        return own


def write_surfaces(models, settings, path, materials):
    def is_surface(element):
        return not is_luminaire(element) and not any(element.is_a(name) for name in LEFT_OUT)

    count = 0
    with open(path, "w", encoding="utf-8") as file:
        for model, element, geometry in (
            (model, *shape) for model in models for shape in shapes(model, settings, is_surface)
        ):
            places = corners(geometry)
            file.write(f"o {element.is_a()}_{element.id()}\n")
            file.writelines("v {:.6f} {:.6f} {:.6f}\n".format(*place) for place in places)
            names = [materials.name(model, style) for style in geometry.materials] or ["surface"]
            if names == ["surface"]:
                materials.keys.setdefault("surface", f"albedo = {DEFAULT}\n")
            faces, ids = geometry.faces, geometry.material_ids
            for number in range(len(faces) // 3):
                which = ids[number] if number < len(ids) else 0
                file.write(f"usemtl {names[max(which, 0)] if which < len(names) else names[0]}\n")
                file.write("f " + " ".join(str(count + 1 + index) for index in faces[3 * number : 3 * number + 3]) + "\n")
            count += len(places)
    return count


def luminaires(model, settings, files, out):
    text, number = "", 0
    for element, geometry in shapes(model, settings, is_luminaire):
        places = corners(geometry)
        low, high = [[pick(place[axis] for place in places) for axis in range(3)] for pick in (min, max)]
        kind = ifcopenshell.util.element.get_type(element)
        names = f"{element.Name or ''} {(kind.Name if kind else None) or ''}"
        file = next((own for name, own in files if name and name in names), None)
        file = file or next((own for name, own in files if not name), None)
        if file is None:
            print(f"note: no photometric file for the luminaire {names.strip()}: give --ies", file=sys.stderr)
            continue
        shutil.copy(file, out / file.name)
        number += 1
        position = [round(0.5 * (low[0] + high[0]), 4), round(low[1] - 0.005, 4), round(0.5 * (low[2] + high[2]), 4)]
        label = (element.Name or "luminaire").replace('"', "'")
        text += f'[[light]]\nname = "{label}"\ntype = "luminaire"\nfile = "{file.name}"\nposition = {position}\n'
    return text, number


def rooms(model, settings, own):
    text, number = "", 0
    for element, geometry in shapes(model, settings, lambda other: other.is_a("IfcSpace")):
        places = corners(geometry)
        low, high = [[pick(place[axis] for place in places) for axis in range(3)] for pick in (min, max)]
        size = [high[axis] - low[axis] - 2 * own.border for axis in (0, 2)]
        if min(size) < LEAST or high[1] - low[1] <= own.height:
            print(f"note: the room {element.Name} is too small for meters", file=sys.stderr)
            continue
        number += 1
        label = " ".join(part for part in (element.Name, element.LongName) if part).replace('"', "'") or f"room {number}"
        corner = [round(low[0] + own.border, 4), round(low[1] + own.height, 4), round(low[2] + own.border, 4)]
        text += f'[[meter]]\nname = "{label}"\ncorner = {corner}\n'
        text += f"edges = [[{size[0]:.4f}, 0, 0], [0, 0, {size[1]:.4f}]]\nnormal = [0, 1, 0]\n"
        for key in ("required_mean", "required_uniformity", "maintenance_factor"):
            if getattr(own, key) is not None:
                text += f"{key} = {getattr(own, key)}\n"
    return text, number


def main():
    own = arguments()
    own.out.mkdir(parents=True, exist_ok=True)
    models = [ifcopenshell.open(str(path)) for path in own.models]
    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    files = [("", pathlib.Path(word)) if "=" not in word else (word.split("=")[0], pathlib.Path(word.split("=", 1)[1])) for word in own.ies]
    materials = Materials()
    vertices = write_surfaces(models, settings, own.out / "building.obj", materials)
    if vertices == 0:
        sys.exit(f"{own.models[0]}: the model has no surfaces")
    parts = [luminaires(model, settings, files, own.out) for model in models]
    lights, luminaire_count = "".join(text for text, _ in parts), sum(count for _, count in parts)
    parts = [rooms(model, settings, own) for model in models]
    meters, room_count = "".join(text for text, _ in parts), sum(count for _, count in parts)
    lines = (own.out / "building.obj").read_text(encoding="utf-8").splitlines()
    places = [list(map(float, line.split()[1:])) for line in lines if line.startswith("v ")]
    middle = [0.5 * (min(own) + max(own)) for own in zip(*places)]
    away = max(max(own) - min(own) for own in zip(*places))
    eye = [round(middle[0] + 0.8 * away, 3), round(middle[1] + 0.6 * away, 3), round(middle[2] + 0.8 * away, 3)]
    text = f"[camera]\nposition = {eye}\ntarget = {[round(own, 3) for own in middle]}\nfov_x_deg = 60\n"
    text += '[[mesh]]\nfile = "building.obj"\n'
    text += "".join(f"[materials.{name}]\n{keys}" for name, keys in materials.keys.items())
    if not lights:
        text += '[sky]\nmodel = "cie"\ncie_type = 16\ndiffuse_lx = 10000\nalbedo = 0.2\n'
    (own.out / "scene.toml").write_text(text + lights + meters, encoding="utf-8")
    print(f"{own.out}: {vertices} vertices, {len(materials.keys)} materials, {luminaire_count} luminaires, {room_count} rooms")


if __name__ == "__main__":
    main()
