"""Examples of the documentation run, at small sizes."""

import ast
import inspect
import re
from pathlib import Path
from typing import Any

import bdpm
import pytest
from bdpm import _bdpm

ROOT = Path(__file__).resolve().parents[2]
PAGES = ["python/README.md", "docs/tutorials/python.md"]


def blocks(page: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```$", (ROOT / page).read_text(), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("page", PAGES)
def test_examples_run(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = blocks(page)
    assert found, "the page has no example"
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    monkeypatch.chdir(tmp_path)
    scope: dict[str, object] = {}
    for block in found:
        short = re.sub(r"\btime=\d+", "time=0.5", block)
        short = re.sub(r"resolution=\(\d+, \d+\)", "resolution=(32, 32)", short)
        exec(compile(short, page, "exec"), scope)


def test_stubs_have_the_keywords_of_the_extension() -> None:
    tree = ast.parse((ROOT / "python/bdpm/_bdpm.pyi").read_text())
    classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}

    def keys(name: str) -> set[str]:
        targets = [row.target for row in classes[name].body if isinstance(row, ast.AnnAssign)]
        found = {target.id for target in targets if isinstance(target, ast.Name)}
        bases = [base.id for base in classes[name].bases if isinstance(base, ast.Name)]
        return found.union(*(keys(base) for base in bases if base in classes))

    scene = bdpm.load(ROOT / "scenes/cornell-box")
    functions: list[tuple[Any, set[str], set[str]]] = [
        (_bdpm.start, keys("RenderOptions"), set()),
        (_bdpm.analyze, keys("AnalyzeOptions"), {"progress"}),
        (_bdpm.calibrate, keys("_JobOptions"), {"time"}),
    ]
    for function, stub, more in functions:
        with pytest.raises(TypeError, match="unknown keyword `tme`") as error:
            function(scene, tme=3)
        known = str(error.value).split("use one of ")[1].split(", ")
        assert set(known) == stub | more, function
        own = set(inspect.signature(function).parameters) - {"scene", "settings"}
        assert own <= set(known), function


def test_every_public_name_is_documented() -> None:
    for name in bdpm.__all__:
        member = getattr(bdpm, name)
        assert name == "__version__" or (member.__doc__ or "").strip(), name
        for attribute in vars(member) if isinstance(member, type) else []:
            if not attribute.startswith("_"):
                assert (getattr(member, attribute).__doc__ or "").strip(), f"{name}.{attribute}"


def test_reference_has_every_name_and_keyword() -> None:
    page = (ROOT / "docs/reference/python.md").read_text()
    for name in set(bdpm.__all__) - {"__version__"}:
        assert re.search(rf"\b{name}\b", page), f"{name} is not on the page"
    # Functions whose row has their keywords; others take the options of the page's second table.
    functions: list[Any] = [bdpm.load, bdpm.convert, bdpm.measure, bdpm.glare, bdpm.judge, bdpm.calibrate]
    functions.append(bdpm.Scene.from_meshes)
    for function in functions:
        row = re.search(rf"^\| `(?:Scene\.)?{function.__name__}\((.*?)\)`", page, re.MULTILINE)
        assert row, function
        found = set(re.findall(r"\w+", row.group(1)))
        parameters = inspect.signature(function).parameters.values()
        own = {one.name for one in parameters if one.kind is not inspect.Parameter.VAR_KEYWORD}
        # Options of the second table
        own -= {"progress", "options", "settings", "threads", "accel"}
        assert own <= found, f"{function.__name__}: {own - found}"
