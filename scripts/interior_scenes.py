#!/usr/bin/env python3
"""Public interiors in Mitsuba 0.6's dialect as scenes that Mitsuba 3 and bdpm both read.

usage: interior_scenes.py [--sky SKY.exr] FOLDER/scene.xml...

The scenes are those of https://github.com/hchoi405/dppm-scenes, folders of `scenes/`, and of
https://github.com/jgarciapueyo/mitsuba2-transient-scenes. Each is written beside its source as room.xml. Of what it
says, this changes:

- the integrator is `path`, of unlimited length, and the film has a box filter and no gamma,
- textures are interpolated bilinearly, for Mitsuba 3 has nothing else,
- `roughdiffuse` is `diffuse` of the same albedo, and `bumpmap` the surface without its bumps,
- `phong` is `roughplastic` of the same diffuse albedo, with alpha = sqrt(2 / (exponent + 2)) and Fresnel's reflectance
  in place of its own; microfacets distributed by `phong` are so by `beckmann`, with the same alpha,
- a color of `#rrggbb` is linear, and a spectrum of three numbers a color, as Mitsuba 0.6 reads them,
- a conductor has air around it (`extEta`),
- opaque surfaces are `twosided`, for bdpm shows the back of each,
- a shape whose file is missing is left out, with a line that says so, and so are surfaces and textures without a user;
  the case of a file's name is that of the file,
- the sampler is `independent`, and what Mitsuba 3 does not know is dropped: `high_quality_edges` of the film, the
  distribution of smooth materials,
- sun and sky are the map that --sky names, for the plugin `sunsky` is another one in Mitsuba 3.

Surfaces, lights, colors, refractive indices and cameras stay.
"""

import argparse
import pathlib
import re
import shutil
import sys
import xml.etree.ElementTree as tree

CONDUCTORS = ("conductor", "roughconductor")
OPAQUE = (*CONDUCTORS, "diffuse", "plastic", "roughplastic")
SMOOTH = ("conductor", "dielectric", "thindielectric", "plastic")


def named(element, kind, name):
    return [child for child in element if child.get("name") == name and (kind is None or child.tag == kind)]


def drop(element, *names):
    for name in names:
        for child in named(element, None, name):
            element.remove(child)


def without_bumps(parent):
    """The surface below each `bumpmap`, in its place and with its name."""
    for place, child in enumerate(list(parent)):
        without_bumps(child)
        if child.tag == "bsdf" and child.get("type") == "bumpmap":
            inner = child.find("bsdf")
            if "id" in child.attrib:
                inner.set("id", child.get("id"))
            parent[place] = inner


def on_disk(folder, name):
    """The name of a file whatever its case, or None."""
    if (folder / name).exists():
        return name
    path = pathlib.PurePath(name)
    siblings = (folder / path.parent).glob("*")
    return next((str(path.with_name(f.name)) for f in siblings if f.name.lower() == path.name.lower()), None)


def without_absentees(root, folder):
    """The scene without shapes that have no file, and without what nothing refers to."""
    for shape in root.findall("shape"):
        for child in named(shape, "string", "filename"):
            name = on_disk(folder, child.get("value"))
            if name is None:
                print(f"interior_scenes.py: no {folder / child.get('value')}", file=sys.stderr)
                root.remove(shape)
            else:
                child.set("value", name)
    count = None
    while count != len(root):
        count = len(root)
        used = {ref.get("id") for ref in root.iter("ref")}
        for child in list(root):
            if child.tag in ("bsdf", "texture") and child.get("id") not in used:
                root.remove(child)


def with_two_sides(root):
    """The scene with an opaque surface on the back of each that would be black there."""
    for parent in [root, *root.iter("shape")]:
        for place, child in enumerate(list(parent)):
            if child.tag == "bsdf" and child.get("type") in OPAQUE:
                parent[place] = tree.Element("bsdf", {**child.attrib, "type": "twosided"})
                child.attrib = {"type": child.get("type")}
                parent[place].append(child)


def convert_color(element):
    value = element.get("value")
    if element.tag == "rgb" and value.startswith("#"):
        element.set("value", ", ".join(f"{int(value[i:i + 2], 16) / 255:.6g}" for i in (1, 3, 5)))
    if element.tag == "spectrum" and ":" not in value and len(re.split(r"[\s,]+", value.strip())) == 3:
        element.tag = "rgb"


def convert_element(element, sky):
    kind = element.get("type")
    if element.tag in ("rgb", "spectrum"):
        convert_color(element)
    if element.tag == "bsdf" and kind == "phong":
        for child in named(element, "float", "exponent"):
            child.set("name", "alpha")
            child.set("value", f"{(2 / (float(child.get('value')) + 2)) ** 0.5:.6g}")
        element.set("type", "roughplastic")
        drop(element, "specularReflectance")
    if element.tag == "bsdf" and kind in SMOOTH:
        drop(element, "distribution")
    if element.tag == "bsdf":
        for child in named(element, "string", "distribution"):
            child.set("value", child.get("value").replace("phong", "beckmann"))
    if element.tag == "bsdf" and kind in CONDUCTORS:
        drop(element, "extEta")
    if element.tag == "bsdf" and kind == "roughdiffuse":
        element.set("type", "diffuse")
        drop(element, "alpha", "useFastApprox")
    if element.tag == "texture" and kind == "bitmap":
        drop(element, "gamma")
        for child in named(element, "string", "filterType"):
            child.set("value", "bilinear")
    if element.tag == "film":
        drop(element, "gamma", "banner", "high_quality_edges")
    if element.tag == "rfilter":
        element.set("type", "box")
    if element.tag == "sampler":
        element.set("type", "independent")
        for child in named(element, "integer", "sampleCount"):
            child.set("value", "16")
    if element.tag == "emitter" and kind == "sunsky":
        if sky is None:
            sys.exit("interior_scenes.py: the scene has sun and sky: give their map with --sky")
        for child in list(element):
            element.remove(child)
        element.set("type", "envmap")
        tree.SubElement(element, "string", name="filename", value=sky.name)


def convert(source, sky):
    root = tree.parse(source).getroot()
    for child in list(root):
        if child.tag in ("default", "integrator"):
            root.remove(child)
    root.insert(0, tree.Element("integrator", type="path"))
    without_bumps(root)
    without_absentees(root, source.parent)
    for element in root.iter():
        convert_element(element, sky)
        if "value" in element.attrib:
            element.set("value", re.sub(r"\$\w+", "", element.get("value")))
    with_two_sides(root)
    if sky is not None and not (source.parent / sky.name).exists():
        shutil.copy(sky, source.parent / sky.name)
    target = source.with_name("room.xml")
    tree.ElementTree(root).write(target, encoding="utf-8", xml_declaration=True)
    return target


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sky", type=pathlib.Path)
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    options = parser.parse_args()
    for source in options.scenes:
        print(convert(source, options.sky))


if __name__ == "__main__":
    main()
