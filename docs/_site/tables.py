"""What `make docs` writes anew: the table of options, and tables and figures from benchmarks/results."""

import re
from functools import partial
from pathlib import Path
from statistics import geometric_mean

import typer.main

from gppcs.app.program import program

ROOT = Path(__file__).parents[2]


def options_table():
    """Return the rows for all options of `gppcs simplify`."""
    rows = ["| option | meaning |", "|---|---|"]
    for option in typer.main.get_command(program()).commands["simplify"].params:
        if option.param_type_name == "option":
            names = ", ".join(f"`{name}`" for name in sorted(option.opts, key=len, reverse=True))
            value = "" if option.is_flag else f" `{(option.metavar or 'N').replace('|', ' or ')}`"
            meaning = first_sentence(option.help).replace("|", "\\|").replace("{", "`{").replace("}", "}`")
            rows.append(f"| {names}{value} | {meaning} |")
    return "\n".join(rows) + "\n"


def first_sentence(text):
    """Return the first sentence of a help text."""
    return re.split(r"(?<=[.])\s", " ".join(text.split()))[0]


def measured(page, heading):
    """Return the rows of a table of a page of results, with its header; cells are texts."""
    text = (ROOT / "benchmarks" / "results" / f"{page}.md").read_text()
    table = re.search(rf"^{re.escape(heading)}\n\n(?:[^|#\n].*\n\n)?((?:\|.*\n)+)", text, re.MULTILINE)[1]
    header, _, *rows = ([cell.strip() for cell in line.strip("|").split(" | ")] for line in table.splitlines())
    return [header, *rows]


def row(page, heading, *cells):
    """Return the row of a table of results that begins with some cells, by the names of columns."""
    header, *rows = measured(page, heading)
    return next(dict(zip(header, each, strict=True)) for each in rows if each[: len(cells)] == list(cells))


def quoted(page, heading, chosen=lambda cells: True, columns=None):
    """Return a table of results, or some of its rows and columns, as Markdown.

    `columns` has a title for each number of a column.
    """
    header, *rows = measured(page, heading)
    rows = list(filter(chosen, rows))
    if columns:
        header, rows = list(columns.values()), [[cells[i] for i in columns] for cells in rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in [header, ["---"] * len(header), *rows])


def number(cell):
    """Return the number at the start of a cell."""
    return float(cell.split()[0].replace(",", ""))


def short(value):
    """Return a number with two digits at least, as texts have it."""
    return f"{value:.2g}" if value < 10 else f"{value:,.0f}"


LEFT_OUT = ("172,974", "1,400,000", "5,000,000")  # clouds that the table of stages leaves out
DRAGON, SAMPLES = ("Dragon", "437,645"), ("samples of the Dragon's mesh", "14,000,000", "28,000")
STAGES, MEMORY = "## gp, seconds of its stages", "## Peak memory above the input, bytes a point"
METHODS, LIMITS = "## All methods, seconds", "## Limits of the machine"
BY_THREADS = "## gp by one thread and by all, seconds"


def percent(ratio):
    """Return by how many percent a ratio differs from 1."""
    return f"{100 * abs(ratio - 1):.1f}"


TUNED, HELD_OUT = "## Summary: the rules were found on these clouds", "## Summary: held-out clouds"
# Held-out clouds that later helped to tell noise from detail, or to decide how much normals count in thin parts.
HELPED = ("lion", "turbine", "tum_desk", "fan", "moth", "case", "plate")
H_MEAN, GAP = "H mean, times the best rival's", "covering radius, times that of fps"
SCENES = "## Summary: geometric means of gp divided by fps"


def by_cloud(heading, column, left_out=(), page="quality"):
    """Return a column of a summary of quality, without the mean and without clouds whose names start in some ways."""
    header, *rows = measured(page, heading)
    cells = [each[header.index(column)].strip("*") for each in rows if not each[0].startswith(("**", *left_out))]
    return [number(cell) for cell in cells if cell]


def margins(heading):
    """Return on how many clouds H mean is the smallest, of how many, and by how many percent in the geometric mean."""
    values = by_cloud(heading, H_MEAN)
    mean = row("quality", heading, "**geometric mean**")[H_MEAN]
    return str(sum(value < 1.0 for value in values)), str(len(values)), percent(number(mean))


def margins_of_others():
    """Return the same for the held-out clouds without those that helped to decide a rule later."""
    values = by_cloud(HELD_OUT, H_MEAN, HELPED)
    return str(sum(value < 1.0 for value in values)), str(len(values)), percent(geometric_mean(values))


def largest_margin():
    """Return by how many percent H mean of `gp` is larger than that of the best other method, where it is worst."""
    return (percent(max(by_cloud(HELD_OUT, H_MEAN))),)


def thin_margin():
    """Return the same in the geometric mean of tubes and ribbed cases."""
    return (percent(geometric_mean(by_cloud("## Summary", H_MEAN, page="thin"))),)


def largest_gap():
    """Return by how many percent the largest gap is larger than that of `fps`, where it is worst."""
    return (percent(max(by_cloud(TUNED, GAP) + by_cloud(HELD_OUT, GAP))),)


def scene_error():
    """Return by how many percent the mean error of held-out scenes is smaller than that of `fps`."""
    return (percent(number(row("scenes", SCENES, "mean distance to the local surface, 1e-4 diagonals")["held out"])),)


def dragon_seconds(method="gp"):
    """Return the seconds of a method on the Dragon."""
    return (short(number(row("speed", METHODS, *DRAGON, "13,129")[method])),)


def large_cloud():
    """Return the seconds of `gp` on 14 million points, and the bytes a point."""
    return short(number(row("speed", STAGES, *SAMPLES)["in all"])), row("speed", MEMORY, *SAMPLES)["gp"]


def memory():
    """Return the bytes a point of 14 million points and of the Dragon."""
    return row("speed", MEMORY, *SAMPLES)["gp"], row("speed", MEMORY, *DRAGON, "13,129")["gp"]


def limits():
    """Return what the machine can do: GB/s of two threads, ns of a line, GFLOP/s of one and of two."""
    copied, lines, flops = (each[1:] for each in measured("speed", LIMITS)[1:])
    return short(number(copied[1])), lines[0], short(number(flops[0])), short(number(flops[1]))


def pass_over_points(stage, gigabytes):
    """Return the milliseconds of a stage of 14 million points: at the speed of copies, measured, and their ratio."""
    copied = number(measured("speed", LIMITS)[1][2])
    bound, actual = 1000 * gigabytes / copied, 1000 * number(row("speed", STAGES, *SAMPLES)[stage])
    return short(bound), short(actual), short(actual / bound)


def by_threads():
    """Return how many times as fast two threads are as one: the least and the largest."""
    ratios = [number(each[-1]) for each in measured("speed", BY_THREADS)[1:]]
    return short(min(ratios)), short(max(ratios))


def starts():
    """Return the seconds of compilation and those of a warm process."""
    warm = measured("engine", "## A whole process, warm")[1][1]
    return short(number(row("engine", "## First run", "gp")["seconds of compilation"])), short(number(warm))


SMALL_CLOUDS = re.compile(r"## [\d,]+ clouds of ([\d,]+) points to ([\d,]+), milliseconds for each")


def small_clouds():
    """Return the milliseconds of a small cloud in one thread by size, a column for each method."""
    text = (ROOT / "benchmarks" / "results" / "small_clouds.md").read_text()
    lines = []
    for size in SMALL_CLOUDS.finditer(text):
        methods, times, *_ = zip(*measured("small_clouds", size[0])[1:], strict=True)
        if not lines:
            lines = [["points", "kept", *(name.replace("_", " ") for name in methods)], ["---"] * (2 + len(methods))]
        lines.append([size[1], size[2], *(f"{short(number(time))} ms" if time[:1].isdigit() else "" for time in times)])
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


BESIDE_BEST_RIVAL = {
    0: "cloud",
    1: "H mean",
    2: "best rival",
    7: "mean error",
    8: "best rival",
    12: "largest gap, times that of `fps`",
}
BESIDE_EACH_RIVAL = {0: "rival", 2: "H mean", 6: "mean error"}
SCENES_COLUMNS = {0: "measure", 1: "all", 5: "held out", 7: "largest", 8: "conditions"}
SPEED_COLUMNS = {
    0: "cloud", 1: "points", 2: "kept", 3: "`gp`", 4: "`gp-spectral`", 6: "`fps`", 7: "`hc`", 8: "`wlop`"
}  # fmt: skip
GALLERY = "# Sample scans of 200,000 points, of which 5 % are kept; lengths in 1e-4 diagonals"
EACH_RIVAL = "## Geometric means, gp divided by each rival"


def best_rivals(heading):
    """Return `gp` beside the best rival on each cloud."""
    return quoted("quality", heading, columns=BESIDE_BEST_RIVAL)


def each_rival():
    """Return `gp` beside each rival on the held-out clouds."""
    return quoted("quality", EACH_RIVAL, columns=BESIDE_EACH_RIVAL).replace("; ahead on", ",")


def denoised():
    """Return how far points lie from the true surface: `gp`, `wlop`, and the best ways with other tools."""
    shown = ("gp", "gp, denoise", "wlop, moved", "APSS, scale 4, then fps", "APSS, scale 8, then fps")
    heading = "## Mean distance of the kept points from the true surface, 1e-4 diagonals"
    return quoted("denoising", heading, lambda cells: cells[0] in shown)


DETAIL = "# Attributes that count beside the shape"
DETAIL_COLUMNS = {
    0: "cloud",
    1: "attribute",
    5: "error of the attribute",
    7: "by the nearest kept point",
    8: "mean error of the shape",
    9: "largest gap",
}


def detailed():
    """Return what an attribute beside the shape changes, divided by the figures of `gp` alone."""
    return quoted("detail", DETAIL, lambda cells: cells[2] == "gp, detail", DETAIL_COLUMNS)


def best_values():
    """Return the least and the most that the best values leave of the error of `gp`."""
    header, *rows = measured("detail", DETAIL)
    left = [float(cells[header.index("times that of gp")]) for cells in rows if cells[2] == "best values there"]
    return f"{min(left):.2f}", f"{max(left):.2f}"


def detail_times():
    """Return how many times as long the choice takes with an attribute: the least and the most."""
    header, *rows = measured("detail", DETAIL)
    times = [float(cells[header.index("time")]) for cells in rows if cells[2] == "gp, detail"]
    return f"{min(times):.1f}", f"{max(times):.1f}"


REGISTRATION = (
    "# Registration by Open3D 0.20.0, original and simplified clouds: medians of errors and least CPU seconds of 5 runs"
)
SUCCESSES = "runs of 5 within 5 degrees"


def successes(cloud, *ratios):
    """Return how many runs found the motion between two views at some ratios, of how many."""
    header, *rows = measured("paper_registration", REGISTRATION)
    runs = [
        int(cells[header.index(SUCCESSES)])
        for cells in rows
        if cells[0].endswith("two views") and cells[1] in ratios and cells[2] == cloud
    ]
    return sum(runs), 5 * len(runs)


def registrations():
    """Return how many runs found the motion, by cloud and ratio."""
    lines = ["| cloud | two views, a tenth of the points | two views, 3 % of the points |", "| --- | --- | --- |"]
    for cloud in ("original", "original, global step on a voxel grid", "gp", "hc", "gp-spectral"):
        counts = ["{} of {}".format(*successes(cloud, ratio)) for ratio in ("0.1", "0.03")]
        lines.append(f"| {' | '.join([cloud, *counts])} |")
    return "\n".join(lines) + "\n"


def all_successes():
    """Return how many runs found the motion: with points of `gp`, of how many, and with all points."""
    kept, runs = successes("gp", "0.1", "0.03")
    return str(kept), str(runs), str(successes("original", "0.1", "0.03")[0])


def registration_seconds():
    """Return CPU seconds for two views of the Dragon at 3 %: by `gp`, to thin, with all points, by a voxel grid."""
    rows = [
        row("paper_registration", REGISTRATION, "Dragon, two views", "0.03", cloud)
        for cloud in ("gp", "original", "original, global step on a voxel grid")
    ]
    kept, *unthinned = (short(number(cells["features + global + ICP, s"])) for cells in rows)
    return kept, short(number(rows[0]["simplification, s"])), *unthinned


def placed(heading):
    """Return what the placement is worth over the clouds of a heading."""
    return quoted("placement", heading, lambda cells: "mean" in cells[0])


# Tables by page: name of the marks around them, and what makes them.
TABLES = {
    "docs/usage.md": [("options", options_table)],
    "docs/ask.md": [("detail", detailed)],
    "docs/results.md": [
        ("held-out clouds", partial(best_rivals, HELD_OUT)),
        ("each rival", each_rival),
        ("scenes", lambda: quoted("scenes", SCENES, columns=SCENES_COLUMNS)),
        ("denoising", denoised),
        ("speed", lambda: quoted("speed", METHODS, lambda cells: cells[1] not in LEFT_OUT, SPEED_COLUMNS)),
        ("small clouds", small_clouds),
        ("registration", registrations),
        ("placement, held-out clouds", partial(placed, "## held-out clouds")),
        ("gallery", lambda: quoted("gallery", GALLERY)),
    ],
    "research/cost.md": [("stages", lambda: quoted("speed", STAGES, lambda cells: cells[1] not in LEFT_OUT))],
    "README.md": [
        ("alternatives", lambda: quoted("alternatives", "## The sample scan medallion, 400,000 points")),
    ],
}
# Figures by page: a sentence, and what gives its figures.
SENTENCES = {
    "README.md": [
        ("On {} of {} clouds that had no part in its design", lambda: margins_of_others()[:2]),
        ("its mean error is {} % smaller than that of farthest points", scene_error),
        ("gap is up to {} % larger than that of farthest points", largest_gap),
        ("its mesh is {} % farther from the original than the best one", largest_margin),
        ("on nine tubes and ribbed cases, it is {} % farther", thin_margin),
        ("It thins 437,645 points to 13,129 in {} seconds on two cores", dragon_seconds),
        ("The paper's algorithm, `gp-spectral`, takes {} seconds", partial(dragon_seconds, "gp-spectral")),
    ],
    "docs/usage.md": [
        ("For `gppcs simplify`, that takes [{} seconds]", lambda: starts()[:1]),
        ("[{} s on two cores](../benchmarks/results/speed.md)", dragon_seconds),
    ],
    "docs/ask.md": [
        ("place, {} to {} of the error of `gp` would remain", best_values),
        ("takes {} to {} times as long with `--detail`", detail_times),
    ],
    "docs/methods.md": [
        ("motion in [{} of {} runs](results.md#registration), with all points in {}", all_successes),
    ],
    "docs/results.md": [
        ("Without these seven, `gp` beats the best rival on {} of {} clouds, by {} %", margins_of_others),
        ("There `gp` beats the best rival on {} of {} clouds, by {} %", partial(margins, TUNED)),
        ("to 28,000 in {} s and needs {} bytes of memory a point", large_cloud),
        ("ICP take {} s, and thinning by `gp` {} s. With all points they take {} s, or {} s if", registration_seconds),
    ],
    "research/cost.md": [
        ("as N to the power {}", lambda: (row("speed", STAGES, "**exponent**, Dragon")["in all"],)),
        ("Two threads are {} to {} times as fast as one", by_threads),
        ("`gp` needs {} bytes a point above the input for 14 million points, and {} for the Dragon", memory),
        ("it copies {} GB/s of memory. One thread fetches a line of memory out of order in {} ns. "
         "One core does {} GFLOP/s, two do {}", limits),
        ("1.3 GB | {} ms | {} ms | {} |", partial(pass_over_points, "preparation", 1.3)),
        ("1.0 GB | {} ms | {} ms | {}, because", partial(pass_over_points, "repeats", 1.0)),
        ("A first run of `gp` compiles for {} seconds. A whole process that thins 400,000 points to 12,000 takes {} "
         "seconds", starts),
    ],
}  # fmt: skip


def renewed(page):
    """Return the text of a page with its tables and figures anew."""
    text = (ROOT / page).read_text()
    for name, table in TABLES.get(page, ()):
        begin, end = f"<!-- {name}: made by `make docs` -->\n", f"<!-- end of {name} -->"
        before, rest = text.split(begin)
        text = before + begin + table() + end + rest.split(end)[1]
    for sentence, figures in SENTENCES.get(page, ()):
        parts = [r"\s+".join(map(re.escape, part.split(" "))) for part in sentence.split("{}")]
        match = re.search(r"(\d+(?:[.,]\d+)*)".join(parts), text)
        if not match:
            raise ValueError(f"{page}: expected the sentence {sentence!r}; change it here, too")
        for i, figure in reversed([*enumerate(figures(), start=1)]):
            text = text[: match.start(i)] + figure + text[match.end(i) :]
    return text


if __name__ == "__main__":
    for page in {*TABLES, *SENTENCES}:
        (ROOT / page).write_text(renewed(page))
