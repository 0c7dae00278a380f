"""The options and arguments that commands share, each declared once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from gppcs.app import panels
from gppcs.errors import file_path
from gppcs.methods import METHODS

Ratio = Annotated[
    str | None,
    typer.Option(
        metavar="SHARE",
        help="Share of the points to keep, above 0 and at most 1, such as 0.03 or 3%. Or give --points.",
        rich_help_panel=panels.SIZE,
    ),
]

Points = Annotated[
    str | None,
    typer.Option(
        metavar="M",
        help="Number of points to keep, such as 5000, 5,000, 5k or 1.5M. Or give --ratio.",
        rich_help_panel=panels.SIZE,
    ),
]

Tolerance = Annotated[
    str | None,
    typer.Option(
        metavar="LENGTH[:p95]",
        help="Keep the fewest points whose local surface no original point is farther from than this, outliers aside: "
        "0.5 (in the unit of the coordinates), 0.5mm, or 0.02% of the diagonal. With :p95, :mean or :rms behind it, it "
        "bounds that error instead; with :max, outliers count, too. In place of --points.",
        rich_help_panel=panels.SIZE,
    ),
]

Spacing = Annotated[
    str | None,
    typer.Option(
        metavar="LENGTH",
        help="Keep as many points as have this spacing: 0.05, 5cm or 1%. In place of --points. "
        + " ".join(
            f"{name}: {known.supports['spacing']}" for name, known in METHODS.items() if "spacing" in known.supports
        ),
        rich_help_panel=panels.SIZE,
    ),
]

MaxGap = Annotated[
    str | None,
    typer.Option(
        metavar="LENGTH",
        help="Add points until each original point has a kept one within this distance. Alone or with --points and so "
        "on.",
        rich_help_panel=panels.SIZE,
    ),
]

Unit = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Unit of the coordinates, such as m or mm, for lengths with a unit. By default, the coordinate system of "
        "the input tells it.",
        rich_help_panel=panels.SIZE,
    ),
]

Levels = Annotated[
    str | None,
    typer.Option(
        "--levels",
        metavar="SIZE,...",
        help="Make several sizes at once, such as 10%,3%,1% or 50k,5k, of which each is the start of the next. With "
        "{level} in the name, each is a file: level 0 is the coarsest. Otherwise OUT is the finest, and its attribute "
        "level tells to which level each point belongs first. In place of --points.",
        rich_help_panel=panels.SIZE,
    ),
]

Json = Annotated[bool, typer.Option("--json", help="Print JSON, one object per line.")]

Threads = Annotated[
    int | None,
    typer.Option(metavar="N", help="Number of threads. By default, as many as this process may use cores."),
]

Force = Annotated[bool, typer.Option("--force", help="Overwrite existing files, but never an input.")]

Lossy = Annotated[
    bool,
    typer.Option(
        "--lossy",
        help="Leave out values that the output format cannot hold, and round coordinates. Otherwise this is an error.",
    ),
]

From = Annotated[
    str | None,
    typer.Option(
        "--from",
        metavar="SUFFIX",
        help="Format of the input, such as xyz. By default, the content tells; for text and OBJ, the name.",
        rich_help_panel=panels.INPUT,
    ),
]

To = Annotated[
    str | None,
    typer.Option("--to", metavar="SUFFIX", help="Format of the output, such as ply. By default, the name tells."),
]

Ascii = Annotated[
    bool | None,
    typer.Option(
        "--ascii/--binary",
        help="Write PLY or PCD as text, or as binary data. By default, only PCD that comes from such text is text.",
        show_default=False,
    ),
]

Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Show no progress and print no table. Errors and notes are still printed.")
]

Columns = Annotated[
    str | None,
    typer.Option(
        metavar="NAME,...",
        help="Names of the columns of a text table, such as x,y,z,red,green,blue. They replace those in the file.",
        rich_help_panel=panels.INPUT,
    ),
]

Box = Annotated[
    str | None,
    typer.Option(
        metavar="XMIN,YMIN,...",
        help="Read only the points in this box: xmin,ymin,xmax,ymax or xmin,ymin,zmin,xmax,ymax,zmax.",
        rich_help_panel=panels.INPUT,
    ),
]

Only = Annotated[
    str | None,
    typer.Option(
        metavar="CONDITION",
        help="Read only the points that meet a condition on attributes and x, y, z, such as 'classification == 6 and z "
        "> 2.5'.",
        rich_help_panel=panels.INPUT,
    ),
]

Inside = Annotated[
    Path | None,
    typer.Option(
        "--polygon",
        metavar="FILE",
        parser=file_path,
        help="Read only the points inside the polygons of a GeoJSON file, in the coordinate system of the input.",
        rich_help_panel=panels.INPUT,
    ),
]

Keep = Annotated[
    str | None,
    typer.Option(
        metavar="CONDITION",
        help="Keep all points that meet a condition on attributes and x, y, z, such as 'classification == 6'. They "
        "count in --points, and the others are chosen where these are not (method gp).",
        rich_help_panel=panels.CHOICE,
    ),
]

Weight = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Multiply the density of the kept points by this attribute, from 0 on (method gp).",
        rich_help_panel=panels.CHOICE,
    ),
]

Seed = Annotated[
    int | None,
    typer.Option(
        help="Seed of random numbers. Methods without random numbers ignore it.", rich_help_panel=panels.METHOD
    ),
]

Resolution = Annotated[
    float | None,
    typer.Option(
        metavar="LENGTH",
        help="Read a COPC file only down to the level on which neighbours are about that far from each other.",
        rich_help_panel=panels.INPUT,
    ),
]

DropInvalid = Annotated[
    Literal["invalid"] | None,
    typer.Option(
        "--drop",
        help="Leave out the points with NaN or infinite coordinates, which are otherwise an error.",
        rich_help_panel=panels.INPUT,
    ),
]

Merge = Annotated[
    bool,
    typer.Option(
        "--merge",
        help="Take all inputs as one cloud, in the order in which they are given.",
        rich_help_panel=panels.INPUT,
    ),
]

AssumeSameCrs = Annotated[
    bool,
    typer.Option(
        "--assume-same-crs",
        help="If several files are one cloud, give all of them the coordinate system of the first file. Without this "
        "option, files with different coordinate systems are an error.",
        rich_help_panel=panels.INPUT,
    ),
]

Memory = Annotated[
    str | None,
    typer.Option(
        metavar="SIZE",
        help="How much memory to use, such as 2GB; half of what is free by default. The points of a larger cloud go to "
        "temporary files, where other points are chosen than in memory, but equally good ones.",
        rich_help_panel=panels.LARGE,
    ),
]

Workers = Annotated[
    str | None,
    typer.Option(
        metavar="COUNT|ADDRESS",
        help="Share the work among this many processes of this machine, in place of threads, or among the workers of a "
        "Dask scheduler, such as tcp://10.0.0.5:8786.",
        rich_help_panel=panels.LARGE,
    ),
]

DryRun = Annotated[
    bool,
    typer.Option(
        "--dry-run",
        help="Print what would be done and in how much memory, and do nothing.",
        rich_help_panel=panels.LARGE,
    ),
]

View = Annotated[
    str | None,
    typer.Option(
        metavar="AZIMUTH,ELEVATION",
        help="Direction of the view, in degrees. At 0,0 it is horizontal with x to the right (y with --up x or -x). "
        "A larger azimuth moves the viewer to the right around the cloud, a larger elevation up. Guessed by default.",
        rich_help_panel=panels.LOOK,
    ),
]

Up = Annotated[
    Literal["x", "y", "z", "-x", "-y", "-z"] | None,
    typer.Option(
        help="The axis that points up in the picture. Guessed by default.",
        rich_help_panel=panels.LOOK,
    ),
]

Colour = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="What the colours of the points in the picture show: rgb, variation (surface variation), or an attribute "
        "of the input. By default surface variation, which shows where a method should keep more points.",
        rich_help_panel=panels.LOOK,
    ),
]
