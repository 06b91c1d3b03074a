"""The panel: two numbers, error and time, and the denoiser; all else folded away."""

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from . import reports

# Panels of Blender that are of no use here.
EXCLUDED = {"VIEWLAYER_PT_filter", "VIEWLAYER_PT_layer_passes", "RENDER_PT_freestyle", "RENDER_PT_gpencil"}
# Those of other engines that are.
BORROWED_ENGINES = {"BLENDER_EEVEE", "BLENDER_EEVEE_NEXT", "BLENDER_RENDER"}
BORROWED = ("EEVEE_MATERIAL_PT_", "EEVEE_WORLD_PT_surface", "DATA_PT_EEVEE_light", "DATA_PT_EEVEE_spot")


class BdpmSettings(bpy.types.PropertyGroup):
    """Of a scene."""

    use_error: BoolProperty(name="Stop at an Error", default=True)
    error: FloatProperty(
        name="Error",
        description="Stop at this error of the image, noise and bias together, relative to each pixel's brightness",
        default=2.0,
        min=0.01,
        max=100.0,
        precision=2,
        subtype="PERCENTAGE",
    )
    use_time: BoolProperty(name="Stop after a Time", default=True)
    time: FloatProperty(
        name="Time",
        description="Stop after this time, seconds, if the error is not reached before",
        default=60.0,
        min=0.1,
        soft_max=86400.0,
    )
    use_denoising: BoolProperty(
        name="Denoise",
        description="Denoise with Intel Open Image Denoise; the error is then that of the denoised image",
        default=False,
    )
    exposure: FloatProperty(
        name="Film Exposure",
        description="The image is multiplied with 2 to the power of this",
        soft_min=-10,
        soft_max=10,
    )
    use_passes: BoolProperty(
        name="Light and Noise Passes",
        description="Albedo, direct and indirect light, caustics, emission, and error as passes",
        default=True,
    )
    seed: IntProperty(name="Seed", description="Of all random numbers", default=1, min=0)
    threads: IntProperty(name="Threads", description="0 for all processors", default=0, min=0, max=1024)
    use_iterations: BoolProperty(name="Fixed Iterations", default=False)
    iterations: IntProperty(name="Iterations", default=64, min=1)
    options: StringProperty(name="Options", description="More options of `bdpm render`, such as --strategy mis")


class _Panel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {"BDPM"}

    @classmethod
    def poll(cls, context):
        """Only where this engine renders."""
        return context.engine in cls.COMPAT_ENGINES


class BDPM_PT_render(_Panel, bpy.types.Panel):
    """Error, time, and the denoiser."""

    bl_label = "BDPM"
    bl_order = -1  # before Blender's own

    def draw(self, context):
        """Two rows and a check box."""
        layout, settings = self.layout, context.scene.bdpm
        layout.use_property_split = True
        layout.use_property_decorate = False
        for use, value, heading in (("use_error", "error", "Error"), ("use_time", "time", "Time (s)")):
            row = layout.row(heading=heading)
            row.prop(settings, use, text="")
            part = row.row()
            part.active = getattr(settings, use)
            part.prop(settings, value, text="")
        layout.prop(settings, "use_denoising")
        _draw_report(layout, reports.of(context.scene.name))


def _draw_report(layout, report):
    if report.error:
        box = layout.box()
        for line in report.error.splitlines():
            box.label(text=line, icon="ERROR")
    answer = report.answer
    if answer.get("relative_error") is not None:
        layout.label(text=f"Error of the last image: {100 * answer['relative_error']:.2f} %")


class BDPM_PT_advanced(_Panel, bpy.types.Panel):
    """What nobody needs to look at."""

    bl_label = "Advanced"
    bl_parent_id = "BDPM_PT_render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """A column of settings."""
        layout, settings = self.layout, context.scene.bdpm
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(settings, "exposure")
        layout.prop(context.scene.render, "film_transparent")
        layout.prop(settings, "use_passes")
        layout.prop(settings, "seed")
        layout.prop(settings, "threads")
        row = layout.row(heading="Iterations")
        row.prop(settings, "use_iterations", text="")
        row.prop(settings, "iterations", text="")
        layout.prop(settings, "options")


class BDPM_PT_remarks(_Panel, bpy.types.Panel):
    """What is approximated or ignored."""

    bl_label = "Not as in Blender"
    bl_parent_id = "BDPM_PT_render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """A line each."""
        report = reports.of(context.scene.name)
        column = self.layout.column(align=True)
        lines = report.remarks + report.notes
        if not lines:
            column.label(text="Nothing of the last render")
        for line in lines:
            column.label(text=line)


class BDPM_PT_passes(_Panel, bpy.types.Panel):
    """Passes of a view layer."""

    bl_label = "Passes"
    bl_context = "view_layer"

    def draw(self, context):
        """Those of Blender that there are, and ours."""
        layout, layer = self.layout, context.view_layer
        layout.use_property_split = True
        layout.prop(layer, "use_pass_z", text="Depth")
        layout.prop(layer, "use_pass_normal", text="Normal")
        layout.prop(context.scene.bdpm, "use_passes")


CLASSES = (BdpmSettings, BDPM_PT_render, BDPM_PT_advanced, BDPM_PT_remarks, BDPM_PT_passes)


def _borrowed():
    """Panels of Blender to show for this engine as well."""
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", None)
        if engines is None or panel.__name__ in EXCLUDED:
            continue
        is_common = "BLENDER_RENDER" in engines and not panel.__name__.startswith("EEVEE")
        is_ours = panel.__name__.startswith(BORROWED) and engines & BORROWED_ENGINES
        if is_common or is_ours:
            yield panel


def register():
    """Makes panels and settings known."""
    for one in CLASSES:
        bpy.utils.register_class(one)
    bpy.types.Scene.bdpm = PointerProperty(type=BdpmSettings)
    for panel in _borrowed():
        panel.COMPAT_ENGINES.add("BDPM")


def unregister():
    """Takes them away."""
    for panel in bpy.types.Panel.__subclasses__():
        if panel not in CLASSES and "BDPM" in getattr(panel, "COMPAT_ENGINES", ()):
            panel.COMPAT_ENGINES.discard("BDPM")
    del bpy.types.Scene.bdpm
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)
