"""What a shader is to bdpm: one of its kinds of surfaces, with what it is made of."""

from dataclasses import KW_ONLY, dataclass, replace

import numpy as np

from .values import Picture, combine, is_constant, mean

BLACK = np.zeros(3)
WHITE = np.ones(3)
GLASS_IOR = 1.5


@dataclass(frozen=True)
class Look:
    """A surface. Colors and numbers are constants or pictures (`values`)."""

    # diffuse, principled (facets over a diffuse base, to metal), gloss (facets of one color from all sides),
    # glass, sheet (reflects and transmits diffusely), or clear (nothing but a tint)
    kind: str = "diffuse"
    color: object = None
    # The others have names wherever a surface is made, so that a new one cannot take the place of another.
    _: KW_ONLY
    # Color of the diffuse light that a sheet transmits; `color` is that of the light it reflects.
    transmitted: object = None
    roughness: object = 0.5
    metallic: object = 0.0
    ior: float = GLASS_IOR
    # Abbe number of glass; None if it does not disperse.
    abbe: float | None = None
    # Facets that scatter once, as opposed to those that make up for what is scattered again.
    once: bool = False
    normal: object = None
    normal_scale: float = 1.0
    emission: object = None
    opacity: object = 1.0
    # The medium behind the surface (`volumes`), or None.
    interior: object = None

    def is_clear(self):
        """Whether light passes it as if nothing were there."""
        return self.kind == "clear" and is_constant(self.color) and bool((mean(self.color) >= 0.999).all())

    def is_black(self):
        return self.kind == "diffuse" and is_constant(self.color) and not mean(self.color).any()


EMPTY = Look(color=BLACK)


def emission_sum(a, b, remark):
    """Of two that may be None."""
    if a is None or b is None:
        return b if a is None else a
    return combine(lambda x, y: x + y, [a, b], remark)


def scaled(value, share, remark):
    if value is None:
        return None
    return combine(lambda v, s: v * s, [value, share], remark)


def mix(share, a, b, remark):
    """Of shares 1 - `share` and `share`; `remark` is told what is no exact mixture."""
    rest = combine(lambda s: 1 - s, [share], remark)
    emission = emission_sum(scaled(a.emission, rest, remark), scaled(b.emission, share, remark), remark)
    if is_constant(share) and float(mean(share)) <= 0:
        return replace(a, emission=emission)
    if is_constant(share) and float(mean(share)) >= 1:
        return replace(b, emission=emission)
    if a.is_clear() and b.is_clear():
        return a
    for clear, other, part in ((a, b, share), (b, a, rest)):
        if clear.is_clear():
            opacity = combine(lambda o, s: o * s, [other.opacity, part], remark)
            # What shines does so for its share; lights are cut by their emission.
            return replace(other, opacity=opacity, emission=emission)
    for black, other, part in ((a, b, share), (b, a, rest)):
        if black.is_black() and other.kind in {"diffuse", "gloss", "clear", "sheet"}:
            color, transmitted = (scaled(own, part, remark) for own in (other.color, other.transmitted))
            return replace(other, color=color, transmitted=transmitted, emission=emission)
    if a.kind == b.kind == "diffuse":
        color = combine(lambda s, x, y: x + s * (y - x), [share, a.color, b.color], remark)
        return replace(a, color=color, emission=emission)
    if _make_sheet(a, b):
        sheet = _sheet_of(lambda s, x, y: x + s * (y - x), [share], a, b, remark)
        return replace(sheet, emission=emission)
    return replace(_between(share, a, b, remark), emission=emission)


def _make_sheet(a, b):
    """Whether two surfaces together scatter as a sheet does: one transmits diffuse light, the other has a base."""
    kinds = {a.kind, b.kind}
    has_base = all(look.kind != "principled" or float(mean(look.metallic)) < 0.5 for look in (a, b))
    return "sheet" in kinds and kinds <= {"sheet", "diffuse", "principled"} and has_base


def _sheet_of(function, values, a, b, remark):
    """The sheet whose colors are `function` of `values` and those of both."""
    if "principled" in {a.kind, b.kind}:
        remark("a mixture of principled and translucent; took a sheet without highlights")
    a, b = (look if look.kind == "sheet" else replace(look, transmitted=BLACK) for look in (a, b))

    def color(name):
        return combine(function, [*values, getattr(a, name), getattr(b, name)], remark)

    return replace(a, kind="sheet", color=color("color"), transmitted=color("transmitted"))


def _between(share, a, b, remark):
    """A principled surface between two, or that of the larger share."""
    weight = float(mean(share))
    major = b if weight >= 0.5 else a
    if not {a.kind, b.kind} <= {"diffuse", "principled", "gloss"}:
        remark(f"a mixture of {a.kind} and {b.kind}; took {major.kind} alone")
        return major
    remark(f"a mixture of {a.kind} and {b.kind}; took one surface of their mean color, roughness and metal")
    a, b = _principled(a), _principled(b)

    def between(name):
        x, y = getattr(a, name), getattr(b, name)
        return combine(lambda s, p, q: p + s * (q - p), [share, x, y], remark)

    # Diffuse light has no highlights: their width is that of the other.
    roughness = between("roughness")
    if a.ior == 1 or b.ior == 1:
        roughness = b.roughness if a.ior == 1 else a.roughness
    major = b if weight >= 0.5 else a
    ior = a.ior + weight * (b.ior - a.ior)
    return replace(major, color=between("color"), roughness=roughness, metallic=between("metallic"), ior=ior)


def _principled(look):
    if look.kind == "diffuse":
        return replace(look, kind="principled", roughness=1.0, metallic=0.0, ior=1.0)
    if look.kind == "gloss":
        return replace(look, kind="principled", metallic=1.0)
    return look


def add(a, b, remark):
    """The sum of two shaders."""
    emission = emission_sum(a.emission, b.emission, remark)
    for black, other in ((a, b), (b, a)):
        if black.is_black():
            return replace(other, emission=emission)
    if a.kind == b.kind == "diffuse":
        color = combine(lambda x, y: np.minimum(x + y, 1), [a.color, b.color], remark)
        return replace(a, color=color, emission=emission)
    if _make_sheet(a, b):
        sheet = _sheet_of(lambda x, y: np.minimum(x + y, 1), [], a, b, remark)
        return replace(sheet, emission=emission)
    half = np.float64(0.5)
    mixed = _between(half, a, b, remark)
    return replace(mixed, emission=emission)


def is_picture(value):
    return isinstance(value, Picture)
