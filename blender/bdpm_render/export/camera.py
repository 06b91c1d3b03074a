"""The camera of a scene file: Blender's, with shift, depth of field and the region that is rendered."""

import math

import numpy as np

from . import axes
from .error import ExportError


def size(scene):
    """Pixels across and down of the whole image."""
    render = scene.render
    scale = render.resolution_percentage / 100
    return max(1, int(render.resolution_x * scale)), max(1, int(render.resolution_y * scale))


def region(scene):
    """What is rendered of the image: left, bottom, right and top in pixels."""
    width, height = size(scene)
    render = scene.render
    if not render.use_border:
        return 0, 0, width, height

    def pixel(share, side):
        # In single precision, as Blender does, which rounds 79.999998 to 80.
        return int(np.float32(share) * np.float32(side))

    left, right = (pixel(share, width) for share in (render.border_min_x, render.border_max_x))
    bottom, top = (pixel(share, height) for share in (render.border_min_y, render.border_max_y))
    return left, bottom, max(right, left + 1), max(top, bottom + 1)


def table(depsgraph, remark):
    """Keys of `[camera]`. Raises ExportError without a camera that bdpm has."""
    scene = depsgraph.scene_eval
    if scene.camera is None:
        raise ExportError("There is no camera in the scene. Add one, and make it the active camera")
    camera = scene.camera.evaluated_get(depsgraph)
    data = camera.data
    kind = getattr(data, "type", None)
    if kind not in ("PERSP", "ORTHO"):
        kind = str(kind or "other").lower()
        raise ExportError(f"The camera {camera.name} is {kind}. Make it perspective or orthographic")
    width, height = size(scene)
    render = scene.render
    projection = camera.calc_matrix_camera(
        depsgraph, x=width, y=height, scale_x=render.pixel_aspect_x, scale_y=render.pixel_aspect_y
    )
    if abs(projection[0][0] * width - projection[1][1] * height) > 1e-3 * projection[0][0] * width:
        remark(camera.name, "pixels that are no squares become squares")
    left, bottom, right, top = region(scene)
    # From the whole image to the region, in widths and heights of the region.
    share_x, share_y = (right - left) / width, (top - bottom) / height
    # The shift is in the column of the depth, which is constant in an orthographic projection.
    offset_x, offset_y = (-projection[i][3] if kind == "ORTHO" else projection[i][2] for i in (0, 1))
    shift_x = (offset_x / 2 + (left + right) / (2 * width) - 0.5) / share_x
    shift_y = (offset_y / 2 + (bottom + top) / (2 * height) - 0.5) / share_y
    world = camera.matrix_world.normalized()
    keys = {
        "position": axes.vector(world.translation),
        "direction": axes.vector(-world.col[2].xyz),
        "up": axes.vector(world.col[1].xyz),
    }
    if kind == "ORTHO":
        keys |= {"type": "orthographic", "width": 2 * share_x / projection[0][0]}
    else:
        keys["fov_x_deg"] = math.degrees(2 * math.atan(share_x / projection[0][0]))
    if abs(shift_x) > 1e-9 or abs(shift_y) > 1e-9:
        keys["shift"] = [shift_x, shift_y]
    if kind == "PERSP":
        _add_lens(keys, camera, world, remark)
    if getattr(render, "use_motion_blur", False):
        remark(camera.name, "motion blur is ignored")
    return keys


def _add_lens(keys, camera, world, remark):
    data = camera.data
    if not data.dof.use_dof:
        return
    radius = data.lens * 1e-3 / (2 * max(data.dof.aperture_fstop, 1e-5))
    distance = data.dof.focus_distance
    if data.dof.focus_object is not None:
        focus = data.dof.focus_object
        bone = focus.pose.bones.get(data.dof.focus_subtarget) if focus.pose and data.dof.focus_subtarget else None
        point = (focus.matrix_world @ bone.matrix if bone else focus.matrix_world).translation
        distance = abs((point - world.translation).dot(world.col[2].xyz))
    if radius < 1e-7 or distance <= 0:
        return
    keys |= {"type": "thin-lens", "aperture_radius": radius, "focus_distance": distance}
    if data.dof.aperture_blades > 2 or abs(data.dof.aperture_ratio - 1) > 1e-6:
        remark(camera.name, "the aperture is a disc")
