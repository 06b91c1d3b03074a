"""What the last render of each scene told, for the panel."""

from dataclasses import dataclass, field


@dataclass
class Report:
    """Of one render."""

    remarks: list = field(default_factory=list)
    notes: list = field(default_factory=list)
    error: str = ""
    answer: dict = field(default_factory=dict)
    export_seconds: float = 0.0


_reports = {}


def of(scene_name):
    """That of the last render of a scene of this name."""
    return _reports.setdefault(scene_name, Report())


def begin(scene_name):
    """A new one."""
    _reports[scene_name] = Report()
    return _reports[scene_name]
