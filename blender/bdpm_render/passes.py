"""Passes of Blender's render layers, from the layers of bdpm's image."""

import numpy as np

from .export import axes

# Name, channels, letters and Blender's kind.
EXTRA = (
    ("Albedo", 3, "RGB", "COLOR"),
    ("Direct", 3, "RGB", "COLOR"),
    ("Indirect", 3, "RGB", "COLOR"),
    ("Caustics", 3, "RGB", "COLOR"),
    ("Emission Light", 3, "RGB", "COLOR"),
    ("Error", 1, "X", "VALUE"),
)
NOISY = ("Noisy Image", 4, "RGBA", "COLOR")


def wanted(settings):
    """The passes besides Combined, Depth and Normal, as (name, channels, letters, kind)."""
    extra = EXTRA if settings.use_passes else ()
    return (*extra, NOISY) if settings.use_denoising else extra


def combined(channels, exposure, alpha=None, background=None):
    """RGBA of the picture itself, as float32 of shape (height, width, 4)."""
    rgb = np.stack([channels[name] for name in "RGB"], axis=-1)
    return _with_alpha(rgb, exposure, alpha, background)


def _with_alpha(rgb, exposure, alpha, background):
    height, width, _ = rgb.shape
    out = np.ones((height, width, 4), np.float32)
    out[..., :3] = rgb * exposure
    if alpha is not None:
        out[..., 3] = np.clip(alpha, 0, 1)
        if background is not None:
            seen = (1 - out[..., 3:]) * background * exposure
            out[..., :3] = np.maximum(out[..., :3] - seen, 0)
    return out


def of(channels, settings, exposure, background=None):
    """All passes by name, each of shape (height, width, channels), the first row on top.

    `background`: radiance of what is around, of a transparent film, or None."""
    alpha = channels["alpha.Y"] if background is not None else None

    def layer(name, letters="RGB"):
        return np.stack([channels[f"{name}.{letter}"] for letter in letters], axis=-1)

    noisy = combined(channels, exposure, alpha, background)
    passes = {"Combined": noisy, "Noisy Image": noisy}
    if "denoised.R" in channels:
        passes["Combined"] = _with_alpha(layer("denoised"), exposure, alpha, background)
    passes["Depth"] = channels["depth.Z"][..., None]
    passes["Normal"] = axes.from_scene(layer("normal", "XYZ"))
    passes["Albedo"] = layer("albedo")
    for name, source in (
        ("Direct", "direct"),
        ("Indirect", "indirect"),
        ("Caustics", "caustics"),
        ("Emission Light", "emission"),
    ):
        passes[name] = layer(source) * exposure
    if "rms.Y" in channels:
        passes["Error"] = channels["rms.Y"][..., None] * exposure
    return passes


def put(layer, passes):
    """Writes passes into those that a layer of a render result has."""
    for layer_pass in layer.passes:
        values = passes.get(layer_pass.name)
        if values is None or values.shape[2] > layer_pass.channels:
            continue
        flat = np.ascontiguousarray(values[::-1, :, : layer_pass.channels], np.float32)
        _set(layer_pass.rect, flat.reshape(-1, layer_pass.channels))


def _set(rect, pixels):
    """Blender 3 counts pixels here, and later versions numbers; both take all of the buffer."""
    try:
        rect.foreach_set(pixels.reshape(-1))
    except TypeError:
        rect.foreach_set(pixels)
