"""Scenes and the program for all tests."""

import os
from pathlib import Path

import bdpm
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def box() -> bdpm.Scene:
    """The Cornell box with one point light."""
    return bdpm.load(ROOT / "scenes/cornell-box")


@pytest.fixture(scope="session")
def program() -> str:
    """The program `bdpm` of the same build."""
    return os.environ["BDPM"]
