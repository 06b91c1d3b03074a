#!/usr/bin/env python3
"""Wraps comments of Rust files that are wider than 100 columns, from the first line that is too wide to the end of its
paragraph. Lists, tables, headings and code blocks keep their lines. `--check` only lists what is too wide."""

import re
import sys
from pathlib import Path

WIDTH = 100
COMMENT = re.compile(r"^(\s*)(///|//!|//)( ?)(.*)$")
# Words; code spans and the texts of links are not broken.
WORD = re.compile(r"(?:`[^`]*`|\[[^\]]*\](?:\([^)]*\))?|[^\s`\[]|[`\[])+")
MARKER = re.compile(r"^(\s*)([-*] |\d+\. )")


def is_paragraph(text):
    """Whether the text of a comment may be joined with what precedes it."""
    return bool(text.strip()) and not re.match(r"\s*([-*] |\d+\. |#|\||```|>|    |SAFETY)", text)


def wrap(words, first, rest):
    lines, line = [], first
    for word in words:
        gap = "" if line in (first, rest) and (not lines or line == rest) else " "
        if line == first and not lines:
            gap = ""
        if len(line) + len(gap) + len(word) > WIDTH and line.strip() not in ("///", "//!", "//"):
            lines.append(line.rstrip())
            line, gap = rest, ""
        line += gap + word
    lines.append(line.rstrip())
    return lines


def wrapped(text):
    lines = text.split("\n")
    out, i, in_code = [], 0, False
    while i < len(lines):
        match = COMMENT.match(lines[i])
        if match and match[4].lstrip().startswith("```"):
            in_code = not in_code
        if not match:
            in_code = False
        if not match or in_code or len(lines[i]) <= WIDTH or match[4].startswith(("|", "#", "http")):
            out.append(lines[i])
            i += 1
            continue
        indent, kind, _, content = match.groups()
        marker = MARKER.match(content)
        hang = " " * len(marker[0]) if marker else re.match(r"\s*", content)[0]
        first = f"{indent}{kind} " + (marker[0] if marker else hang)
        words = WORD.findall(content[len(marker[0]):] if marker else content)
        i += 1
        while i < len(lines):
            following = COMMENT.match(lines[i])
            if not following or following[1] != indent or following[2] != kind:
                break
            if not is_paragraph(following[4]):
                break
            words += WORD.findall(following[4])
            i += 1
        out += wrap(words, first, f"{indent}{kind} {hang}")
    return "\n".join(out)


def main():
    check = "--check" in sys.argv
    for name in sys.argv[1:]:
        if name == "--check":
            continue
        path = Path(name)
        text = path.read_text()
        if check:
            for number, line in enumerate(text.split("\n"), 1):
                if len(line) > WIDTH and COMMENT.match(line):
                    print(f"{name}:{number}")
        elif (new := wrapped(text)) != text:
            path.write_text(new)


main()
