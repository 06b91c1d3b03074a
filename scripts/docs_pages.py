#!/usr/bin/env python3
"""Pages of the documentation as a source of mdBook, and a check of the finished site.

    docs_pages.py write FOLDER    copy all pages to FOLDER, with formulas as mdbook-katex expects them
    docs_pages.py preprocess      be a preprocessor of mdBook after mdbook-katex: leave out the LaTeX of formulas
    docs_pages.py check FOLDER    check that all links and pictures of the site in FOLDER exist

The folders are those of the repository, so that links between pages hold. scripts/docs.sh calls both.
"""

import json
import re
import shutil
import sys
from html.parser import HTMLParser
from os.path import relpath
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parent.parent
PROJECT = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "python/README.md", "blender/README.md", "sys/README.md"]
FENCE = re.compile(r"^( *)```")
LINK = re.compile(r"\]\(([^)\s#]+)")
# Code, links, and the numbers of equations outside of both.
CITATION = re.compile(r"`[^`]*`|\[[^]]*\]\([^)]*\)|\((?P<number>\d+[a-z]?)\)")
THEORY = re.compile(r"\]\([./a-z]*theory\.md\), \((\d+[a-z]?)\)")
RUST = "\n## The library\n\n[Documentation of the crate `bdpm`](../rust/bdpm/index.html) and of the crates below it.\n"


def equation(formula: str) -> str:
    """A formula as HTML with its number beside it, and an anchor such as `eq-93h`."""
    number = re.search(r"\\tag\{(\w+)\}", formula)
    formula = " ".join(re.sub(r"\\tag\{\w+\}", "", formula).split())
    if number is None:
        return f'<div class="equation"><div>⟦{formula}⟧</div></div>'
    name = number[1]
    return f'<div class="equation" id="eq-{name}"><div>⟦{formula}⟧</div><a href="#eq-{name}">({name})</a></div>'


def chapters() -> dict[str, Path]:
    """The chapter of the theory, from the root, that has each number of an equation."""
    pages = sorted((ROOT / "docs/explanation/theory").glob("*.md"))
    tags = {page.relative_to(ROOT): re.findall(r"\\tag\{(\w+)\}", page.read_text(encoding="utf-8")) for page in pages}
    return {number: page for page, numbers in tags.items() for number in numbers}


def with_links_to_equations(line: str, page: Path, where: dict[str, Path]) -> str:
    """A line of text whose citations of equations are links: all in the theory, elsewhere those after its name."""
    if line.startswith("#"):
        return line

    def link(number: str) -> str:
        return f"{relpath(where[number], page.parent)}#eq-{number}"

    def cited(citation: re.Match[str]) -> str:
        number = citation["number"]
        return f"[({number})]({link(number)})" if number in where else citation[0]

    if "theory" in page.with_suffix("").parts:
        return CITATION.sub(cited, line)
    return THEORY.sub(lambda found: f"]({link(found[1])}), ({found[1]})" if found[1] in where else found[0], line)


def converted(text: str, page: Path, where: dict[str, Path]) -> str:
    """A page with its blocks of formulas as HTML, and links to equations."""
    lines, formula, is_code = [], None, False
    for line in text.split("\n"):
        fence = FENCE.match(line)
        if formula is not None:
            if fence:
                lines.append(equation("\n".join(formula)))
                formula = None
            else:
                formula.append(line)
        elif fence and line.strip() == "```math" and not is_code:
            formula = []
        else:
            is_code ^= bool(fence)
            lines.append(line if is_code or fence else with_links_to_equations(line, page, where))
    return "\n".join(lines)


def contents(text: str) -> str:
    """The table of contents, whose links are relative to docs/, for a source in the root."""

    def moved(link: re.Match[str]) -> str:
        target = link[1]
        return "](" + (target.removeprefix("../") if target.startswith("../") else f"docs/{target}")

    return LINK.sub(moved, text)


def write(folder: Path) -> None:
    """Copies all pages, and the files that they link to."""
    where = chapters()
    pages = [ROOT / name for name in PROJECT] + sorted((ROOT / "docs").rglob("*.md"))
    for page in pages:
        text = page.read_text(encoding="utf-8")
        path = page.relative_to(ROOT)
        if path == Path("docs/SUMMARY.md"):
            (folder / "SUMMARY.md").write_text(contents(text), encoding="utf-8")
            continue
        for target in LINK.findall(text):
            linked = (page.parent / target).resolve()
            if linked.is_file() and linked.suffix != ".md" and linked.is_relative_to(ROOT):
                copy = folder / linked.relative_to(ROOT)
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(linked, copy)
        # The site has no page of the contents: it is the sidebar.
        text = re.sub(r"\[([^]]+)\]\([./a-z]*SUMMARY\.md\)", r"\1", text)
        copy = folder / path
        copy.parent.mkdir(parents=True, exist_ok=True)
        text = converted(text, path, where)
        copy.write_text(text + RUST if path == Path("docs/README.md") else text, encoding="utf-8")


# KaTeX repeats the LaTeX of a formula beside its MathML. Markdown would take underscores there for emphasis.
ANNOTATION = re.compile(r"<annotation encoding=.application/x-tex.>.*?</annotation>", re.DOTALL)


def without_annotations(item: Any) -> Any:
    """A part of a book, as mdBook describes it in JSON, without annotations in its pages."""
    if isinstance(item, list):
        return [without_annotations(part) for part in item]
    if isinstance(item, dict):
        return {key: without_annotations(part) for key, part in item.items()}
    return ANNOTATION.sub("", item) if isinstance(item, str) else item


def preprocess() -> None:
    """Reads a book from standard input and writes it, or answers that each output is supported."""
    if sys.argv[2:3] == ["supports"]:
        return
    _, book = json.load(sys.stdin)
    json.dump(without_annotations(book), sys.stdout)


# Addresses in the network from which a page would load something.
LOADED = re.compile(r'(?:<script|<img|<link)[^>]+(?:src|href)="(https?://[^"]+)')


class Page(HTMLParser):
    """Links and anchors of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id" and value:
                self.anchors.add(value)
            elif name in ("href", "src") and value and tag != "base":
                self.links.append(value)


def check(folder: Path) -> list[str]:
    """Links of the site that lead nowhere, and addresses in the network from which something is loaded."""
    own = [path for path in folder.rglob("*.html") if "rust" not in path.relative_to(folder).parts]
    pages = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in own}
    has_rust = (folder / "rust").exists()
    problems = []
    for path, page in pages.items():
        if path.name in ("404.html", "toc.html"):
            continue
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if "rust" in target.parts and not has_rust:
                continue
            place = f"{path.relative_to(folder.resolve())}: {link}"
            if not target.exists():
                problems.append(f"{place}: there is no such file")
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                problems.append(f"{place}: there is no such anchor")
        for loaded in LOADED.findall(path.read_text(encoding="utf-8")):
            problems.append(f"{path.relative_to(folder.resolve())}: it loads {loaded} from the network")
    return sorted(set(problems))


def main() -> None:
    """Runs a command."""
    command = sys.argv[1]
    if command == "preprocess":
        preprocess()
        return
    folder = Path(sys.argv[2])
    if command == "write":
        folder.mkdir(parents=True, exist_ok=True)
        write(folder)
        return
    problems = check(folder)
    if problems:
        sys.exit("docs: error: the site has broken links:\n" + "\n".join(problems))


if __name__ == "__main__":
    main()
