"""Nodes that compute colors and numbers of others: each as a function of arrays, and the inputs that it takes."""

import numpy as np

# Of linear Rec. 709.
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])

EPSILON = 1e-12


def _divide(a, b):
    return np.where(np.abs(b) > EPSILON, a / np.where(np.abs(b) > EPSILON, b, 1.0), 0.0)


MATH = {
    "ADD": lambda a, b, c: a + b,
    "SUBTRACT": lambda a, b, c: a - b,
    "MULTIPLY": lambda a, b, c: a * b,
    "DIVIDE": lambda a, b, c: _divide(a, b),
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b, c: np.nan_to_num(np.power(np.abs(a), b)),
    "LOGARITHM": lambda a, b, c: _divide(np.log(np.maximum(a, EPSILON)), np.log(np.maximum(b, EPSILON))),
    "SQRT": lambda a, b, c: np.sqrt(np.maximum(a, 0)),
    "INVERSE_SQRT": lambda a, b, c: _divide(1.0, np.sqrt(np.maximum(a, 0))),
    "ABSOLUTE": lambda a, b, c: np.abs(a),
    "EXPONENT": lambda a, b, c: np.exp(np.minimum(a, 700)),
    "MINIMUM": lambda a, b, c: np.minimum(a, b),
    "MAXIMUM": lambda a, b, c: np.maximum(a, b),
    "LESS_THAN": lambda a, b, c: (a < b) * 1.0,
    "GREATER_THAN": lambda a, b, c: (a > b) * 1.0,
    "SIGN": lambda a, b, c: np.sign(a),
    "COMPARE": lambda a, b, c: (np.abs(a - b) <= np.maximum(c, 1e-5)) * 1.0,
    "ROUND": lambda a, b, c: np.floor(a + 0.5),
    "FLOOR": lambda a, b, c: np.floor(a),
    "CEIL": lambda a, b, c: np.ceil(a),
    "TRUNC": lambda a, b, c: np.trunc(a),
    "FRACT": lambda a, b, c: a - np.floor(a),
    "MODULO": lambda a, b, c: np.where(b != 0, np.fmod(a, np.where(b != 0, b, 1.0)), 0.0),
    "SINE": lambda a, b, c: np.sin(a),
    "COSINE": lambda a, b, c: np.cos(a),
    "TANGENT": lambda a, b, c: np.tan(a),
    "RADIANS": lambda a, b, c: np.radians(a),
    "DEGREES": lambda a, b, c: np.degrees(a),
}

BLENDS = {
    "MIX": lambda a, b: b,
    "DARKEN": np.minimum,
    "LIGHTEN": np.maximum,
    "MULTIPLY": lambda a, b: a * b,
    "SCREEN": lambda a, b: 1 - (1 - a) * (1 - b),
    "OVERLAY": lambda a, b: np.where(a < 0.5, 2 * a * b, 1 - 2 * (1 - a) * (1 - b)),
    "ADD": lambda a, b: a + b,
    "SUBTRACT": lambda a, b: a - b,
    "DIVIDE": _divide,
    "DIFFERENCE": lambda a, b: np.abs(a - b),
}


def _math(node):
    count = len([socket for socket in node.inputs if socket.enabled])
    operation = MATH.get(node.operation)
    if operation is None:
        return (lambda *values: values[0]), [(0, "number")]

    def function(*values):
        a, b, c = (*values, 0.0, 0.0)[:3]
        result = operation(a, b, c)
        return np.clip(result, 0, 1) if node.use_clamp else result

    return function, [(index, "number") for index in range(count)]


def _blend(mode, clamps):
    blend = BLENDS.get(mode, BLENDS["MIX"])

    def function(share, a, b):
        share = np.clip(share, 0, 1)
        result = a + share * (blend(a, b) - a)
        return np.clip(result, 0, 1) if clamps else result

    return function


def _mix_rgb(node):
    return _blend(node.blend_type, node.use_clamp), [("Fac", "number"), ("Color1", "color"), ("Color2", "color")]


def _mix(node):
    if node.data_type == "RGBA":
        return _blend(node.blend_type, node.clamp_result), [("Factor", "number"), ("A", "color"), ("B", "color")]
    kind = "color" if node.data_type == "VECTOR" else "number"

    def function(share, a, b):
        share = np.clip(share, 0, 1) if node.clamp_factor else share
        return a + share * (b - a)

    return function, [("Factor", "any"), ("A", kind), ("B", kind)]


def _ramp(node):
    places = np.linspace(0, 1, 1025)
    colors = np.array([node.color_ramp.evaluate(place)[:3] for place in places])

    def function(at):
        at = np.clip(np.asarray(at), 0, 1)
        return np.stack([np.interp(at, places, colors[:, k]) for k in range(3)], axis=-1)

    return function, [("Fac", "number")]


def _curves(node):
    mapping = node.mapping
    mapping.initialize() if hasattr(mapping, "initialize") else mapping.update()
    places = np.linspace(0, 1, 257)

    def curve(index, at):
        return mapping.evaluate(mapping.curves[3], mapping.evaluate(mapping.curves[index], at))

    tables = [np.array([curve(index, at) for at in places]) for index in range(3)]

    def function(share, a):
        curved = np.stack([np.interp(a[..., k], places, tables[k]) for k in range(3)], axis=-1)
        return a + share * (curved - a)

    return function, [("Fac", "number"), ("Color", "color")]


def _bright_contrast(node):
    def function(a, bright, contrast):
        return np.maximum((1 + contrast) * a + bright - 0.5 * contrast, 0)

    return function, [("Color", "color"), ("Bright", "number"), ("Contrast", "number")]


def _gamma(node):
    return (lambda a, power: np.power(np.maximum(a, 0), power)), [("Color", "color"), ("Gamma", "number")]


def _invert(node):
    return (lambda share, a: a + share * (1 - 2 * a)), [("Fac", "number"), ("Color", "color")]


def _hue_sat(node):
    def function(hue, saturation, value, share, a):
        hsv = _to_hsv(a)
        h = (hsv[..., 0] + _last(hue) + 0.5) % 1.0
        s = np.clip(hsv[..., 1] * _last(saturation), 0, 1)
        made = _to_rgb(h, s, hsv[..., 2] * _last(value))
        return np.maximum(a + share * (made - a), 0)

    names = ("Hue", "Saturation", "Value", "Fac")
    return function, [(name, "number") for name in names] + [("Color", "color")]


def _last(value):
    value = np.asarray(value)
    return value[..., 0] if value.ndim and value.shape[-1] == 1 else value


def _to_hsv(a):
    high, low = a.max(axis=-1), a.min(axis=-1)
    spread = high - low
    safe = np.where(spread > 0, spread, 1.0)
    r, g, b = (a[..., k] for k in range(3))
    hue = np.where(high == r, (g - b) / safe, np.where(high == g, 2 + (b - r) / safe, 4 + (r - g) / safe))
    hue = np.where(spread > 0, hue / 6 % 1.0, 0.0)
    return np.stack([hue, _divide(spread, high), high], axis=-1)


def _to_rgb(h, s, v):
    ramps = [np.clip(np.abs((h * 6 + shift) % 6 - 3) - 1, 0, 1) for shift in (0, 4, 2)]
    return np.stack([v * (1 + s * (ramp - 1)) for ramp in ramps], axis=-1)


def _map_range(node):
    def function(value, low, high, to_low, to_high):
        share = _divide(value - low, high - low)
        share = np.clip(share, 0, 1) if getattr(node, "clamp", True) else share
        return to_low + share * (to_high - to_low)

    names = ("Value", "From Min", "From Max", "To Min", "To Max")
    return function, [(name, "number") for name in names]


def _clamp(node):
    return (lambda a, low, high: np.clip(a, low, high)), [("Value", "number"), ("Min", "number"), ("Max", "number")]


def _combine(node):
    return (lambda *parts: np.stack(np.broadcast_arrays(*parts), axis=-1)), [(k, "number") for k in range(3)]


def _to_gray(node):
    return (lambda a: a @ LUMINANCE), [(0, "color")]


def _blackbody(node):
    def function(kelvin):
        return blackbody(float(np.mean(kelvin)))

    return function, [("Temperature", "number")]


def blackbody(kelvin):
    """Linear Rec. 709 of luminance 1 of light of that temperature: Planck's law, and a fit of the CIE 1931 observer
    (Wyman, Sloan, Shirley 2013)."""
    nm = np.arange(380.0, 781.0, 5.0)
    planck = nm**-5 / np.expm1(np.minimum(1.438777e7 / (nm * max(kelvin, 800.0)), 700))

    def lobe(center, left, right):
        return np.exp(-0.5 * ((nm - center) * np.where(nm < center, left, right)) ** 2)

    x = 1.056 * lobe(599.8, 0.0264, 0.0323) + 0.362 * lobe(442.0, 0.0624, 0.0374) - 0.065 * lobe(501.1, 0.0490, 0.0382)
    y = 0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322)
    z = 1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725)
    xyz = np.array([planck @ x, planck @ y, planck @ z])
    to_rgb = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
    return np.maximum(to_rgb @ (xyz / xyz[1]), 0)


NODES = {
    "MATH": _math,
    "MIX_RGB": _mix_rgb,
    "MIX": _mix,
    "VALTORGB": _ramp,
    "CURVE_RGB": _curves,
    "BRIGHTCONTRAST": _bright_contrast,
    "GAMMA": _gamma,
    "INVERT": _invert,
    "HUE_SAT": _hue_sat,
    "MAP_RANGE": _map_range,
    "CLAMP": _clamp,
    "COMBRGB": _combine,
    "COMBXYZ": _combine,
    "COMBINE_COLOR": _combine,
    "RGBTOBW": _to_gray,
    "BLACKBODY": _blackbody,
}
