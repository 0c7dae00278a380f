"""The method `gp` beside all rivals on tubes and ribbed cases, whose two sheets are near each other everywhere.

Needs what quality.py needs, and judges as it does.
"""

from __future__ import annotations

import conditions
import quality
from conditions import THIN

INTRODUCTION = (
    "Horn, handlebar and vents helped to tell sheets from noise, and to decide which of two sheets gets more points. "
    "With cable, crate and sink, they decided how much normals count between flat walls; funnel, organizer and louvre "
    "decided nothing. Each figure of gp is divided by that of the best rival on the same cloud. Where gp is behind, "
    "the cell is bold and says so."
)


def main() -> None:
    """Print the tables, and write them if they are of all conditions."""
    chosen, runs = conditions.asked(THIN, __doc__)
    made = dict(zip(chosen, runs.over(chosen, quality.runs_of), strict=True))
    conditions.keep(
        "thin",
        "The method gp beside all rivals on tubes and ribbed cases",
        [
            quality.summary("Summary", made),
            *(conditions.section(condition, of_condition) for condition, of_condition in made.items()),
        ],
        chosen,
        quality.NOTES,
        whole=len(chosen) == len(THIN),
        introduction=INTRODUCTION,
    )


if __name__ == "__main__":
    main()
