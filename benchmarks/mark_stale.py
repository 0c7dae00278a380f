"""Say in each page of `results/` whether the code of `gp` has changed since its figures were measured.

Adds the line to pages whose digest of the code of gp is missing or is not that of the present code, and removes it from
the others.
"""

from __future__ import annotations

import report


def main() -> None:
    """Rewrite the pages that need it, and print their names."""
    for path in sorted((report.HERE / "results").glob("*.md")):
        page = path.read_text()
        if (marked := report.marked(page)) != page:
            path.write_text(marked)
            print(f"{path.name}: {'gp has changed since' if len(marked) > len(page) else 'gp is as it was'}")


if __name__ == "__main__":
    main()
