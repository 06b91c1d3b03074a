"""Examples of the documentation run, at small sizes."""

import re
from pathlib import Path

import bdpm
import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = ["README.md", "python/README.md", "docs/tutorials/python.md"]


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


def test_every_public_name_is_documented() -> None:
    for name in bdpm.__all__:
        member = getattr(bdpm, name)
        assert name == "__version__" or (member.__doc__ or "").strip(), name
        for attribute in vars(member) if isinstance(member, type) else []:
            if not attribute.startswith("_"):
                assert (getattr(member, attribute).__doc__ or "").strip(), f"{name}.{attribute}"
