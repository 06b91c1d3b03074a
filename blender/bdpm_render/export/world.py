"""The world of a scene as bdpm's environment, with the suns that have a size."""

import math
import os
from dataclasses import dataclass

import numpy as np

from .. import exr
from ..nodes.evaluate import Evaluator
from ..nodes.follow import Socket, output_of
from ..nodes.values import is_constant, mean
from ..nodes.volumes import Volumes
from . import axes, bake

# Pixels across a sun, and of a map at the most.
SUN_PIXELS, WIDEST = 6, 8192
FILE = "environment.exr"
# Turns directions so that Blender's +y is in the middle of the map, where Blender has +x.
FROM_SCENE = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])


def write(world, suns, writer, has_stopped):
    """Writes the map if there is one; keys of `[environment]`, or None if the world is black."""
    around = Around(np.zeros(3))
    if world is not None:
        around = _background(world, writer, has_stopped)
    if around.picture is None and not suns:
        return {"radiance": around.radiance} if around.radiance.any() else None
    path = os.path.join(writer.folder, FILE)
    if not suns and around.turn is not None and _is_about_z(around.turn):
        # Blender's middle column looks along +x, bdpm's along -z, which is Blender's +y.
        exr.write_rgb(path, np.maximum(around.picture, 0).astype(np.float32))
        angle = math.degrees(math.atan2(around.turn[1, 0], around.turn[0, 0]))
        return {"file": FILE, "radiance": around.radiance, "turn_deg": -90.0 - angle}
    exr.write_rgb(path, _drawn(around, suns))
    return {"file": FILE}


def medium(world, has_far_light, writer):
    """The name of the medium that fills the space between all objects, or None."""
    if world is None or not world.use_nodes or not world.node_tree:
        return None
    output = output_of(world.node_tree, {"OUTPUT_WORLD"})
    if output is None:
        return None
    where = f"World {world.name}"

    def remark(node, text):
        writer.remark(where, f"{node.label or node.name}: {text}")

    found = Volumes(Evaluator(remark, writer.store), remark).medium(Socket(output.inputs["Volume"]))
    if found is None:
        return None
    if has_far_light:
        writer.remark(where, "its volume is ignored: it would absorb all light of the world and of suns")
        return None
    writer.materials.media[where] = found.keys()
    return where


@dataclass
class Around:
    """What is around a scene: a radiance, or a factor of a map."""

    radiance: np.ndarray
    # Rows from the top, in Blender's directions after a turn; without one, in bdpm's.
    picture: object = None
    turn: object = None


def _is_about_z(turn):
    return abs(turn[2, 2] - 1) < 1e-9


def _background(world, writer, has_stopped):
    """What a world is: by its nodes where they are known, else as Cycles shows it."""
    where = f"World {world.name}"
    if not world.use_nodes or not world.node_tree:
        return Around(np.array(world.color[:3], np.float64))
    output = output_of(world.node_tree, {"OUTPUT_WORLD"})
    if output is None:
        return Around(np.zeros(3))
    source = Socket(output.inputs["Surface"]).source()[0]
    if source is None:
        return Around(np.zeros(3))
    unknown = []
    around = _known(source, writer, unknown)
    if not unknown:
        return around
    baked = bake.bake(world.original, writer.folder, has_stopped)
    if baked is None:
        for text in unknown:
            writer.remark(where, text)
        return around
    writer.remark(where, f"baked to a map of {bake.WIDTH} by {bake.WIDTH // 2} pixels, as the camera sees it")
    channels = exr.read(baked)
    return Around(np.ones(3), np.stack([channels[letter] for letter in "RGB"], axis=-1))


def _known(source, writer, unknown):
    """A background by its nodes; `unknown` takes what of them is not known."""
    if source.node.type not in {"BACKGROUND", "EMISSION"}:
        unknown.append(f"{source.node.name}: only a background is known; took none")
        return Around(np.zeros(3))
    evaluator = Evaluator(lambda node, text: unknown.append(f"{node.name}: {text}"), writer.store)
    strength = max(evaluator.constant(source.input("Strength"), "Strength"), 0.0)
    from_, _ = source.input("Color").source()
    if from_ is not None and from_.node.type == "TEX_ENVIRONMENT":
        pixels, turn = _environment(from_, writer.store, evaluator, unknown.append)
        if pixels is not None:
            return Around(np.full(3, strength), pixels, turn)
        return Around(np.zeros(3))
    color = evaluator.color(source.input("Color"))
    if not is_constant(color):
        unknown.append("its color varies; took the mean")
    return Around(np.maximum(mean(color), 0) * strength)


def _environment(source, store, evaluator, remark):
    node = source.node
    if node.image is None or node.projection != "EQUIRECTANGULAR":
        remark(f"{node.name}: has no image, or is no map of longitude and latitude")
        return None, None
    pixels = store.pixels(node.image)
    if pixels is None:
        remark(f"{node.name}: the image {node.image.name} has no pixels, or its file is missing")
        return None, None
    turn = np.eye(3)
    from_, _ = source.input("Vector").source()
    if from_ is not None and from_.node.type == "MAPPING":
        turn = _mapping(from_, evaluator, remark)
        from_, _ = from_.input("Vector").source()
    if from_ is not None and not (from_.node.type == "TEX_COORD" and from_.output.name == "Generated"):
        if from_.node.type != "NEW_GEOMETRY":
            remark(f"{from_.node.name}: gives coordinates that are not known; took directions")
    return pixels[:, :, :3], turn


def _mapping(source, evaluator, remark):
    """The turn of a mapping node: rows of a matrix."""

    def vector(name):
        return np.array(evaluator.constant_color(source.input(name), name))

    x, y, z = vector("Rotation")
    if np.abs(vector("Scale") - 1).max() > 1e-6 or "Location" in source.node.inputs and vector("Location").any():
        remark(f"{source.node.name}: scale and location are ignored")

    def about(axis, angle):
        matrix = np.eye(3)
        a, b = [k for k in range(3) if k != axis]
        s = math.sin(angle) * (-1 if axis == 1 else 1)
        matrix[a, a] = matrix[b, b] = math.cos(angle)
        matrix[a, b], matrix[b, a] = -s, s
        return matrix

    turn = about(2, z) @ about(1, y) @ about(0, x)
    return turn.T if source.node.vector_type == "TEXTURE" else turn


def _drawn(around, suns):
    """A map in bdpm's directions of everything that is around."""
    picture = around.picture
    height = 2 if picture is None else picture.shape[0]
    for _, radius, _ in suns:
        height = max(height, math.ceil(math.pi * SUN_PIXELS / (2 * radius)))
    height = min(height, WIDEST // 2)
    width = 2 * height
    pixels = np.empty((height, width, 3), np.float32)
    pixels[:] = around.radiance
    if picture is not None:
        turn = FROM_SCENE if around.turn is None else around.turn
        for row in range(0, height, 64):
            rows = slice(row, min(row + 64, height))
            pixels[rows] *= _looked_up(picture, turn, _directions(height, width, rows))
    for direction, radius, irradiance in suns:
        _add_sun(pixels, direction, radius, irradiance)
    return np.maximum(pixels, 0)


def _directions(height, width, rows, columns=slice(None), steps=1):
    """Directions in bdpm's axes of the middles of pixels, or of `steps` by `steps` parts of them."""
    theta = (np.arange(height * steps)[rows.start * steps : rows.stop * steps] + 0.5) * (math.pi / (height * steps))
    phi = (np.arange(width * steps) + 0.5) * (2 * math.pi / (width * steps)) - math.pi
    phi = phi.reshape(width, steps)[columns].reshape(-1)
    sine = np.sin(theta)[:, None]
    y = np.broadcast_to(np.cos(theta)[:, None], (len(theta), len(phi)))
    return np.stack([sine * np.sin(phi), y, -sine * np.cos(phi)], axis=-1)


def _looked_up(picture, turn, directions):
    """Of Blender's map, between four pixels each."""
    blender = axes.from_scene(directions) @ turn.T
    height, width = picture.shape[:2]
    u = 0.5 - np.arctan2(blender[..., 1], blender[..., 0]) / (2 * math.pi)
    v = 0.5 - np.arcsin(np.clip(blender[..., 2], -1, 1)) / math.pi
    x, y = u * width - 0.5, np.clip(v * height - 0.5, 0, height - 1)
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[..., None], (y - y0)[..., None]
    y1 = np.minimum(y0 + 1, height - 1)
    rows = [picture[at, x0 % width] * (1 - fx) + picture[at, (x0 + 1) % width] * fx for at in (y0, y1)]
    return rows[0] * (1 - fy) + rows[1] * fy


def _add_sun(pixels, direction, radius, irradiance):
    """Adds a disc of that angle to the pixels, each by the share of it that it covers."""
    height, width = pixels.shape[:2]
    steps = 4
    theta = math.acos(np.clip(direction[1], -1, 1))
    margin = radius + 2 * math.pi / height
    first = max(0, math.floor((theta - margin) / math.pi * height))
    last = min(height, math.ceil((theta + margin) / math.pi * height) + 1)
    rows = slice(first, last)
    # Columns that it can reach; near the poles all.
    reach = math.pi if math.sin(theta) <= math.sin(min(margin, math.pi / 2)) else margin / math.sin(theta) * 1.5
    phi = math.atan2(direction[0], -direction[2])
    middles = (np.arange(width) + 0.5) * (2 * math.pi / width) - math.pi
    away = np.abs((middles - phi + math.pi) % (2 * math.pi) - math.pi)
    columns = np.nonzero(away <= reach)[0]
    inside = _directions(height, width, rows, columns, steps) @ direction >= math.cos(radius)
    share = inside.reshape(last - first, steps, len(columns), steps).mean(axis=(1, 3))
    edges = np.cos(np.arange(first, last + 1) * math.pi / height)
    solid_angle = (edges[:-1] - edges[1:]) * (2 * math.pi / width)
    cosine = np.clip(_directions(height, width, rows, columns) @ direction, 0, 1)
    total = (share * solid_angle[:, None] * cosine).sum()
    pixels[first:last, columns] += (share[:, :, None] * (irradiance / total)).astype(np.float32)
