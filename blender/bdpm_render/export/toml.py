"""Tables of a scene file as text."""

import json
import math


def value(item):
    """A string, number, boolean, list or dictionary."""
    if isinstance(item, bool):
        return "true" if item else "false"
    if isinstance(item, str):
        # JSON's escapes are TOML's, but for the delete character.
        return json.dumps(item, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(item, int):
        return str(item)
    if isinstance(item, dict):
        return "{ " + ", ".join(f"{key} = {value(entry)}" for key, entry in item.items()) + " }"
    if hasattr(item, "__iter__"):
        return "[" + ", ".join(value(entry) for entry in item) + "]"
    number = float(item)
    if not math.isfinite(number):
        raise ValueError(f"{number} is no number for a scene file")
    return repr(number)


def table(head, keys):
    """A table with its head, such as `[camera]` or `[[mesh]]`."""
    lines = [head] + [f"{key} = {value(item)}" for key, item in keys.items() if item is not None]
    return "\n".join(lines) + "\n"
