"""Pixels of Blender's images, and picture files for bdpm."""

import os
import struct
import zlib

import bpy
import numpy as np

READABLE = {".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp", ".tga"}


def pixels(image):
    """Of shape (height, width, 4) and float32, first row on top, in linear color unless the image is of data.

    None if there are none, as of a file that is missing."""
    width, height = image.size
    if not width or not height or not image.has_data and image.source != "GENERATED":
        # Reading tells whether there is a file.
        try:
            image.pixels[0]
        except (IndexError, RuntimeError):
            return None
        width, height = image.size
    values = np.empty(width * height * image.channels, np.float32)
    if not values.size:
        return None
    image.pixels.foreach_get(values)
    values = values.reshape(height, width, image.channels)[::-1]
    if image.channels < 4:
        full = np.ones((height, width, 4), np.float32)
        full[:, :, :3] = values[:, :, :3] if image.channels == 3 else values[:, :, :1]
        values = full
    if not image.is_float and image.colorspace_settings.name == "sRGB":
        values = values.copy()
        values[:, :, :3] = linear(values[:, :, :3])
    return values


def linear(srgb):
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0) + 0.055) / 1.055) ** 2.4)


def srgb(values):
    values = np.clip(values, 0, 1)
    return np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)


def file_of(image, depsgraph_frame=None):
    """The file of an image that bdpm reads as Blender shows it, or None."""
    if image.source != "FILE" or image.packed_file or image.is_dirty:
        return None
    path = os.path.normpath(bpy.path.abspath(image.filepath_raw, library=image.library))
    fits = os.path.splitext(path)[1].lower() in READABLE and os.path.isfile(path)
    return path if fits and not image.is_float and image.depth <= 32 else None


def write_png(path, values):
    """Writes bytes of shape (height, width, 1, 3 or 4), first row on top."""
    height, width, channels = values.shape
    rows = np.zeros((height, 1 + width * channels), np.uint8)
    rows[:, 1:] = values.reshape(height, -1)

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    kind = {1: 0, 3: 2, 4: 6}[channels]
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        file.write(chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)))
        file.write(chunk(b"IDAT", zlib.compress(rows.tobytes(), 1)))
        file.write(chunk(b"IEND", b""))


def to_bytes(values):
    """Shares as bytes; a number for each pixel becomes one channel."""
    bytes_ = np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)
    return bytes_[:, :, None] if bytes_.ndim == 2 else bytes_
