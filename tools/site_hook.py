"""What the site has beside its pages: examples, tour, joints, MathML."""

from __future__ import annotations

import html
import re
from pathlib import Path

import tour
from joints_page import joints_page
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
TABLE = re.compile(r"<!-- tour -->\n.*?<!-- end -->\n", re.DOTALL)
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def _pages() -> list[tour.Page]:
    return [tour.page_of(path.with_suffix(".ipynb")) for path in tour.scripts()]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add every example as a file of the site, the tour, and the page of the joints."""

    def add(uri: str, content: str | bytes) -> None:
        files.append(File.generated(config, uri, content=content))

    joints, pictures = joints_page()
    add("joints.md", joints)
    for name, svg in pictures.items():
        add(name, svg)
    for page in _pages():
        head, _, rest = page.markdown.partition("\n")
        add(f"tour/{page.name}.md", f"{head}\n\n{_opened(page.name)}\n{rest}")
        for name, picture in page.pictures.items():
            add(f"tour/{name}", picture)
    for path in sorted((ROOT / "examples").rglob("*.*")):
        if path.suffix in (".py", ".toml", ".ipynb"):
            uri = path.relative_to(ROOT).as_posix()
            files.append(File.generated(config, uri, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Show the tour as cards; let links out of the folder of pages lead to the file in the site."""
    if page.file.src_uri == "examples.md":
        cards = "\n".join(_card(one) for one in _pages())
        markdown = TABLE.sub(f'<div class="grid cards" markdown>\n\n{cards}\n\n</div>\n', markdown)
    if page.file.src_uri.startswith("tour/"):
        markdown = markdown.replace("](../../docs/", "](../")
        markdown = re.sub(r"\]\((\d\d_\w+)\.ipynb\)", r"](\1.md)", markdown)
    return re.sub(r"\]\(((?:\.\./)*)\.\./examples/", r"](\1examples/", markdown)


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn formulas into MathML, which browsers draw without a script."""
    return FORMULA.sub(_mathml, content)


def _mathml(found: re.Match[str]) -> str:
    display = "block" if found[1] == "div" else "inline"
    return convert(html.unescape(found[2]).strip(), display=display)


def _opened(name: str) -> str:
    """Return the links with which a part of the tour opens, as Markdown."""
    path = f"examples/tour/{name}"
    notebook = f"[Notebook](../../{path}.ipynb){{ download .badge }}"
    return f"{notebook} [Script](../../{path}.py){{ .badge }}"


def _card(page: tour.Page) -> str:
    """Return a part of the tour as an item of a grid: its picture, title and first sentence."""
    to = f"tour/{page.name}.md"
    first = next(iter(page.pictures), None)
    picture = f"    [![](tour/{first})]({to})\n\n" if first else ""
    return f"-   [**{page.title}**]({to})\n\n{picture}    {page.opening}\n"
