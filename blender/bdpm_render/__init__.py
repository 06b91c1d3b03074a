"""Renders from inside Blender with bdpm: bidirectional photon mapping that knows its own noise."""

bl_info = {
    "name": "BDPM",
    "author": "The authors of bdpm",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "Properties > Render > Render Engine",
    "description": "Renders with bdpm: caustics, and an error that is told and promised",
    "category": "Render",
}

import bpy  # noqa: E402

from . import engine, panel, preferences  # noqa: E402


def register():
    """Called by Blender when the add-on is enabled."""
    bpy.utils.register_class(preferences.BdpmPreferences)
    bpy.utils.register_class(engine.BdpmEngine)
    panel.register()


def unregister():
    """Called by Blender when it is disabled."""
    panel.unregister()
    bpy.utils.unregister_class(engine.BdpmEngine)
    bpy.utils.unregister_class(preferences.BdpmPreferences)
