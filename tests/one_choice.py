"""A choice that a process can be asked for. Test modules themselves cannot be imported by spawned processes: some
packages install a package `tests` of their own."""

import gppcs


def points():
    """Enough points for several threads and parts."""
    return gppcs.sample("fan", n_points=60_000).points


def indices(run):
    """What one run chooses; `run` is its number."""
    gppcs.set_threads(2)
    return gppcs.simplify(points(), n_points=3_000).indices
