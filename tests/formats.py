"""What formats leave out."""

from collections import namedtuple

from gppcs.io import CloudFiles, format_to_write

Loaded = namedtuple("Loaded", "cloud faces unread")


def losses(path, cloud):
    """In words, what a file would not hold of a cloud."""
    fit = format_to_write(path).fit(cloud)
    return [*fit.values, *fit.remarks]


def load(path):
    """A cloud, its number of faces, and in words what is not read."""
    with CloudFiles([path]) as files:
        return Loaded(files.read(), files.n_faces, files.skipped())
