"""The command that the wheel installs, and the Blender add-on that looks for it."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import bdpm
import pytest

ROOT = Path(__file__).resolve().parents[2]


def test_command_is_the_program_of_the_package(program: str) -> None:
    code = "import sys; from bdpm._program import main; sys.argv[1:] = ['--version']; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    expected = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == expected.stdout == f"bdpm {bdpm.__version__}\n"


def test_blender_add_on_finds_the_program_of_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = importlib.util.spec_from_file_location("program", ROOT / "blender/bdpm_render/program.py")
    assert spec is not None and spec.loader is not None
    add_on = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(add_on)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert bdpm.__file__ is not None
    expected = Path(bdpm.__file__).parent / "bin" / "bdpm"
    assert add_on.find("") == str(expected)
    assert add_on.check(str(expected)) == f"bdpm {bdpm.__version__}"
