"""A hook of MkDocs: what a page says of files outside this folder, which the site does not hold.

The tables of `benchmarks/results` become pages of the site. Other links become plain text, until the repository has a
public address that can be put before their paths.
"""

import re
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[2]
TABLES = "../benchmarks/results/"


def on_files(files, config):
    """Add the tables of measurements to the files of the site."""
    for path in sorted((ROOT / "benchmarks" / "results").glob("*.*")):
        files.append(File.generated(config, f"tables/{path.name}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Replace links that lead out of the folder of the pages."""
    if not page.file.src_uri.startswith("tables/"):
        markdown = re.sub(rf"\]\({re.escape(TABLES)}([\w.]+)(#[\w-]*)?\)", r"](tables/\1)", markdown)
    return re.sub(r"(?<!!)\[([^\]]*)\]\(\.\./[^)]*\)", r"\1", markdown)
