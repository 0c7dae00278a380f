"""A hook of MkDocs: files outside this folder that the site has, what becomes of links to others, and formulas.

The pages of `research` and the tables of `benchmarks/results` are pages of the site, too. Links to other files lead to
the repository if `pyproject.toml` has its address as `Source`, and become plain text otherwise. Formulas become MathML,
which browsers draw by themselves.
"""

import re
import tomllib
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.structure.files import File

ROOT = Path(__file__).parents[2]
# Folders of the site by those of the repository.
FOLDERS = {"docs": "", "research": "research/", "benchmarks/results": "tables/"}
SOURCE = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["urls"].get("Source")


def on_files(files, config):
    """Add research and tables of measurements to the files of the site."""
    for folder, name in list(FOLDERS.items())[1:]:
        for path in sorted((ROOT / folder).glob("*.*")):
            files.append(File.generated(config, f"{name}{path.name}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Replace links that lead out of the folder of the page."""
    name, folder = max((name, folder) for folder, name in FOLDERS.items() if page.file.src_uri.startswith(name))

    def link(match):
        image, text, target, anchor = match.groups()
        path = (ROOT / folder / target).resolve().relative_to(ROOT)
        if path.parent.as_posix() in FOLDERS:
            up = "../" * name.count("/")
            return f"{image}[{text}]({up}{FOLDERS[path.parent.as_posix()]}{path.name}{anchor or ''})"
        return f"[{text}]({SOURCE}/blob/HEAD/{path.as_posix()})" if SOURCE else text

    markdown = re.sub(r"(!?)\[([^\]]*)\]\((\.\./[^)#]*)(#[^)]*)?\)", link, markdown)
    markdown = re.sub(r"```math\n(.*?)```", lambda block: _formula(block[1], "block"), markdown, flags=re.DOTALL)
    return re.sub(r"(?<![\w$`])\$([^$`]+)\$(?![\w$])", lambda inline: _formula(inline[1], "inline"), markdown)


def _formula(latex, display):
    """Return a formula as MathML on one line, with its number beside it."""
    latex = re.sub(r"\\tag\{(\w+)\}", r"\\qquad(\1)", " ".join(latex.split()))
    return convert(latex, display=display).replace("\n", " ")
