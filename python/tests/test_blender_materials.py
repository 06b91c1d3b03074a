"""Materials of the Blender add-on, from nodes that only look like Blender's."""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

NODES = Path(__file__).resolve().parents[2] / "blender/bdpm_render"

PRINCIPLED = {
    "Base Color": (0.8, 0.6, 0.4, 1.0),
    "Metallic": 0.0,
    "Roughness": 0.25,
    "IOR": 1.4,
    "Alpha": 1.0,
    "Transmission Weight": 0.0,
    "Coat Weight": 0.0,
    "Coat Roughness": 0.03,
    "Coat IOR": 1.5,
    "Specular IOR Level": 0.5,
    "Specular Tint": (1.0, 1.0, 1.0, 1.0),
    "Emission Color": (1.0, 1.0, 1.0, 1.0),
    "Emission Strength": 0.0,
}


class Inputs(dict[str, SimpleNamespace]):
    """Sockets by name or by place, none of them linked."""

    def __init__(self, values: dict[str, Any]) -> None:
        super().__init__(
            {name: SimpleNamespace(name=name, is_linked=False, default_value=own) for name, own in values.items()}
        )


def keys(kind: str, distribution: str, values: dict[str, Any]) -> dict[str, Any]:
    """The table of a scene file for a material of this one shader."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(NODES))
        # No picture is read or written.
        patch.setitem(sys.modules, "bpy", ModuleType("bpy"))
        from nodes.evaluate import Evaluator  # type: ignore[import-not-found]
        from nodes.shaders import Shaders  # type: ignore[import-not-found]
        from nodes.table import Store, Table  # type: ignore[import-not-found]

        shader = SimpleNamespace(
            type=kind, name=kind, label="", mute=False, distribution=distribution, inputs=Inputs(values)
        )
        output = SimpleNamespace(
            type="OUTPUT_MATERIAL", mute=False, target="ALL", is_active_output=True, name="Output", label=""
        )
        output.inputs = Inputs({"Surface": None, "Volume": None, "Displacement": None})
        link = SimpleNamespace(from_node=shader, from_socket=None, is_muted=False, is_valid=True)
        output.inputs["Surface"].is_linked, output.inputs["Surface"].links = True, [link]
        remarks: list[str] = []
        store = Store("nowhere")
        evaluator = Evaluator(lambda _, text: remarks.append(text), store)
        look = Shaders(evaluator, lambda _, text: remarks.append(text)).material(SimpleNamespace(nodes=[output]))
        table: dict[str, Any] = Table(look, store, remarks.append).keys
    for name in [name for name in sys.modules if name.split(".")[0] == "nodes"]:
        del sys.modules[name]
    return table


@pytest.mark.parametrize(
    ("kind", "distribution", "values", "expected"),
    [
        ("BSDF_PRINCIPLED", "GGX", PRINCIPLED, {"type": "glossy", "roughness": 0.25, "metallic": 0.0, "ior": 1.4}),
        ("BSDF_PRINCIPLED", "GGX", PRINCIPLED | {"Metallic": 1.0}, {"type": "metal", "roughness": 0.25}),
        ("BSDF_PRINCIPLED", "GGX", PRINCIPLED | {"Metallic": 0.7}, {"type": "glossy", "roughness": 0.25, "metallic": 0.7}),
        (
            "BSDF_PRINCIPLED",
            "GGX",
            PRINCIPLED | {"Transmission Weight": 1.0},
            {"type": "dielectric", "roughness": 0.25, "ior": 1.4},
        ),
        (
            "BSDF_PRINCIPLED",
            "GGX",
            PRINCIPLED | {"Transmission Weight": 1.0, "Roughness": 0.0},
            {"type": "dielectric", "roughness": None},
        ),
        ("BSDF_PRINCIPLED", "GGX", PRINCIPLED | {"Coat Weight": 1.0}, {"type": "glossy", "roughness": 0.03, "ior": 1.5}),
        (
            "BSDF_GLOSSY",
            "GGX",
            {"Color": (0.9, 0.9, 0.9, 1.0), "Roughness": 0.2, "Anisotropy": 0.0},
            {"type": "metal", "roughness": 0.2},
        ),
        (
            "BSDF_GLASS",
            "GGX",
            {"Color": (1.0, 1.0, 1.0, 1.0), "Roughness": 0.3, "IOR": 1.6},
            {"type": "dielectric", "roughness": 0.3, "ior": 1.6},
        ),
    ],
)
def test_shaders_keep_their_numbers(
    kind: str, distribution: str, values: dict[str, Any], expected: dict[str, Any]
) -> None:
    found = keys(kind, distribution, values)
    for key, own in expected.items():
        assert found.get(key) == (own if own is None or isinstance(own, str) else pytest.approx(own, abs=1e-9)), found
