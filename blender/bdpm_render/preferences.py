"""Where the program is."""

import bpy

from . import program


class BdpmPreferences(bpy.types.AddonPreferences):
    """Preferences > Add-ons > BDPM."""

    bl_idname = __package__

    program: bpy.props.StringProperty(
        name="Program",
        description="The program bdpm; empty to take the one in this add-on's folder bin, on the PATH, or where pip installs it",
        subtype="FILE_PATH",
    )

    def draw(self, context):
        """Shows the path, and whether the program runs."""
        layout = self.layout
        layout.prop(self, "program")
        try:
            path = program.find(program_path())
            layout.label(text=f"{program.check(path)}: {path}", icon="CHECKMARK")
        except program.ProgramError as error:
            for line in str(error).split(". "):
                layout.label(text=line, icon="ERROR")


def program_path():
    """As the preferences say; empty where they say nothing."""
    addon = bpy.context.preferences.addons.get(__package__)
    return bpy.path.abspath(addon.preferences.program) if addon and addon.preferences else ""
