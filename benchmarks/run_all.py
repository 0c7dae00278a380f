"""Make all tables of `results/` again, the most important first, or those of the experiments of the paper.

A script that needs a package, a program or a cloud that is not there is skipped; data.py says how to get the clouds. A
script that fails does not stop the others. The end is a summary; the exit status is 1 if a script failed. `--stale`
makes nothing, but lists the pages whose methods have changed since.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from shutil import which
from time import perf_counter

import data
import report

METHODS = tuple(f"src/gppcs/{room}" for room in ("spatial", "surface", "gp", "methods", "evaluation"))


@dataclass(frozen=True)
class Script:
    """A script of the benchmarks.

    Attributes
    ----------
    file : str
        Beside this file.
    page : str
        The page of `results/` that it writes.
    needs : tuple of str
        Packages that it imports, beside those of gppcs without extras.
    options : tuple of str
        Words for its command line.
    programs : tuple of str
        Programs that it starts.
    """

    file: str
    page: str
    needs: tuple[str, ...] = ()
    options: tuple[str, ...] = ()
    programs: tuple[str, ...] = ()

    @property
    def missing(self) -> list[str]:
        """The packages, programs and clouds that are not there."""
        return [
            *(name for name in self.needs if not find_spec(name)),
            *(name for name in self.programs if not which(name)),
            *(f"{file.name} ({file})" for file in data.missing_for(self.page)),
        ]

    @property
    def age(self) -> str:
        """Whether the methods have changed since the commit of the page."""
        path = report.HERE / "results" / f"{self.page}.md"
        commit = re.search(r"^- gppcs \S+, commit (\w+)", path.read_text() if path.is_file() else "", re.MULTILINE)
        if not commit:
            return "not made yet"
        command = ["git", "rev-list", "--count", f"{commit[1]}..HEAD", "--", *METHODS]
        done = subprocess.run(command, cwd=report.HERE.parent, capture_output=True, text=True, check=False)
        if done.returncode:
            return f"made at {commit[1]}, which is not in the history"
        count = int(done.stdout)
        return f"made at {commit[1]}; {count} commits have changed the methods since" if count else "up to date"


SCRIPTS = (
    Script("quality.py", "quality", ("pymeshlab", "gppcs_learned"), ("--jobs", "2")),
    Script("thin.py", "thin", ("pymeshlab", "gppcs_learned"), ("--jobs", "2")),
    Script("scenes.py", "scenes", options=("--jobs", "2")),
    Script("speed.py", "speed", ("matplotlib",)),
    Script("small_clouds.py", "small_clouds"),
    Script("engine.py", "engine"),
    Script("lidar.py", "lidar"),
    Script("alternatives.py", "alternatives", ("open3d", "pymeshlab"), programs=("CloudCompare",)),
    Script("why_not_voxels.py", "why_not_voxels", ("pymeshlab", "matplotlib")),
    Script("gallery.py", "gallery", ("matplotlib",)),
    Script("gp_ablation.py", "gp_ablation", ("pymeshlab",)),
    Script("gp_constants.py", "gp_constants"),
    Script("detail.py", "detail", ("meshoptimizer",)),
    Script("placement.py", "placement", ("pymeshlab",), ("--jobs", "2")),
    Script("ask.py", "ask", ("pymeshlab",)),
    Script("denoising.py", "denoising", ("pymeshlab", "CGAL")),
    Script("gp_prefixes.py", "gp_prefixes", ("pymeshlab",)),
    Script("levels.py", "levels"),
    Script("larger_than_memory.py", "larger_than_memory"),
    Script("tiles.py", "tiles"),
    Script("normals.py", "normals", ("pymeshlab",)),
    Script("meshes.py", "meshes", ("pymeshlab",)),
    Script("tolerance.py", "tolerance", ("pymeshlab",)),
    Script("perception.py", "perception", ("pymeshlab", "pyvista")),
    Script("rivals.py", "rivals", ("CGAL",)),
    Script("weighted_poisson.py", "weighted_poisson"),
    Script("viewing.py", "viewing", ("pymeshlab",), programs=("node", "chromium")),
    Script("paper/table1.py", "paper_table1", ("pymeshlab",)),
    Script("paper/ablation.py", "ablation"),
    Script("paper/all_points.py", "all_points"),
    Script("paper/published.py", "paper_published", ("pymeshlab",)),
    Script("paper/differences.py", "paper_differences", ("pymeshlab",)),
    Script("paper/noise.py", "paper_noise", ("pymeshlab",)),
    Script("paper/scans.py", "paper_scans", ("pymeshlab",)),
    Script("paper/scenes.py", "paper_scenes"),
    Script("paper/modelnet.py", "paper_modelnet", ("matplotlib",)),
    Script("learned/edges.py", "learned_edges"),
    Script("learned/sizes.py", "learned_sizes"),
    Script("paper/lucy.py", "paper_lucy", ("pymeshlab",)),
    Script("paper/registration_released.py", "paper_registration_released", ("open3d",)),
    Script("paper/registration.py", "paper_registration", ("open3d",)),
    Script("paper/claims.py", "paper_claims"),  # after the others, whose figures it takes
)


def main() -> None:
    """Run the scripts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    pages = [script.page for script in SCRIPTS]
    parser.add_argument("pages", nargs="*", metavar="PAGE", help=f"one of {', '.join(pages)}; all if none is given")
    parser.add_argument("--paper", action="store_true", help="make the pages of the experiments of the paper")
    parser.add_argument("--stale", action="store_true", help="list how old the pages are, and make none")
    options = parser.parse_args()
    for page in set(options.pages) - set(pages):
        parser.error(f"there is no page {page!r}")
    chosen = [
        script
        for script in SCRIPTS
        if (not options.pages or script.page in options.pages)
        and (not options.paper or script.file.startswith("paper/"))
    ]
    if not options.stale and not report.DATA.is_dir():
        parser.error(f"there are no clouds in {report.DATA}: set GPPCS_DATA to their folder")
    ends = {script: script.age if options.stale else run(script) for script in chosen}
    print("\nSummary", file=sys.stderr)
    for script, end in ends.items():
        print(f"  {script.page}: {end}", file=sys.stderr)
    sys.exit(any(end.startswith("failed") for end in ends.values()))


def run(script: Script) -> str:
    """Run a script, and return how it ended."""
    if script.missing:
        return f"skipped: {', '.join(script.missing)} not there"
    print(f"{script.file}", file=sys.stderr)
    start = perf_counter()
    status = subprocess.run([sys.executable, report.HERE / script.file, *script.options], check=False).returncode
    minutes = f"{(perf_counter() - start) / 60:.1f} minutes"
    return f"failed with status {status} after {minutes}" if status else f"made in {minutes}"


if __name__ == "__main__":
    main()
