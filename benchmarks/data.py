"""Say which clouds of the paper's experiments are in GPPCS_DATA, make those that can be made, and name the others.

With `--fetch`, the files of the Stanford repository, the bust of Nefertiti and the clouds that authors published are
fetched. The others have to be had by hand: their addresses are printed, with what cannot be made without them. The hash
of a cloud is the SHA-256 of its coordinates as little-endian float32, in the order of the file, so it does not depend
on the format. A file that stays as it was published has a commit in its address, which fixes its content.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import sys
import tarfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.request import urlopen

import numpy as np
from numpy.typing import NDArray

import gppcs
import report

STANFORD = "http://graphics.stanford.edu/pub/3Dscanrep"
GITHUB = "https://raw.githubusercontent.com"
LEVELS = ("2.5e-3", "5e-3", "1e-2", "2e-2")  # of the noise of each coordinate, in diagonals of the clean mesh

Array = NDArray[np.float64]


@dataclass(frozen=True)
class File:
    """A cloud or mesh NAME.ply, or a file that stays as it was published.

    Attributes
    ----------
    name : str
        Of the file, without suffix; of one that stays as it is, with its folder and suffix.
    hash : str
        Of the copy with which the pages were made; empty for one that stays as it is.
    origin : str
        Its address, with the file in an archive after `#`, or in words; empty if it is made.
    make : callable, optional
        Returns the points, (N, 3), from other files.
    """

    name: str
    hash: str
    origin: str = ""
    make: Callable[[], Array] | None = None

    @property
    def path(self) -> Path:
        """Where it is expected."""
        return report.DATA / (self.name if self.stays else f"{self.name}.ply")

    @property
    def stays(self) -> bool:
        """Whether it is used as it was published."""
        return "/" in self.name

    def __str__(self) -> str:
        """Return its address, its hash, and the pages that cannot be made without it."""
        identity = "the commit in the address fixes its content" if self.stays else f"hash {self.hash}"
        pages = ", ".join(page for page, names in PAGES.items() if self.name in names) or "other clouds"
        return f"{self.origin or 'made from other files by data.py'}; {identity}; not made without it: {pages}"


def sampled(mesh: str, n: int, seed: int) -> Array:
    """Return n points, (n, 3), on a mesh, uniform by area."""
    mesh_, rng = gppcs.read_mesh(report.DATA / f"{mesh}.ply"), np.random.default_rng(seed)
    areas = mesh_.face_areas()
    a, b, c = (mesh_.vertices[corner] for corner in mesh_.faces[rng.choice(len(areas), n, p=areas / areas.sum())].T)
    u, v = rng.random((2, n, 1))
    root = np.sqrt(u)
    return (1 - root) * a + root * (1 - v) * b + root * v * c


def noisy(clean: str, mesh: str, level: str) -> Array:
    """Return the points of a cloud, (N, 3), with Gaussian noise of each coordinate."""
    points = gppcs.read(report.DATA / f"{clean}.ply").points
    diagonal = np.linalg.norm(np.ptp(gppcs.read_mesh(report.DATA / f"{mesh}.ply").vertices, axis=0))
    rng = np.random.default_rng(round(1e5 * float(level)))
    return points + float(level) * diagonal * rng.standard_normal(points.shape)


def published(repository: str, commit: str, path: str) -> File:
    """Return a file of a commit of a repository on GitHub."""
    return File(f"published/{commit[:7]}_{Path(path).name}", "", f"{GITHUB}/{repository}/{commit}/{path}")


OF_THE_PAPER = tuple(
    published("stutipathak5/gps-for-point-clouds", commit, f"resources/results/{name}")
    for commit, name in (
        ("0dd34b0b90f5d6b71553ab8138c95a5009c68e7c", "bun_zipper.ply.npz"),
        ("4aa6c94fee2fa0b07c1450541935b3525e0934b0", "bun_zipper.ply.npz"),
        ("2739b71294ac2ca4745204cd93ca8d73e061c1b2", "bun_zipper_0.1.npz"),
        ("4aa6c94fee2fa0b07c1450541935b3525e0934b0", "dragon_vrip.ply.xyz"),
    )
)
OF_WEIGHTED_POISSON = tuple(  # a room, and the points that the authors' program made of it
    published("vvvwo/Weighted-Poisson-disk-Resampling", commit, f"WPDEXE/{folder}/conferenceRoom_1.ply")
    for commit, folder in (
        ("4260bf8c7a9de22398803181d3c917683702a092", "input"),
        ("cc2eec4408d219473102e6f0e9765c1c7cff2c07", "output"),
    )
)
FILES = (
    *OF_THE_PAPER,
    *OF_WEIGHTED_POISSON,
    File(
        "bunny",
        "b343f4663008f69bfe13e2e994fc3e112a54392df9366ede3ab33bc936a6ada5",
        f"{STANFORD}/bunny.tar.gz#bunny/reconstruction/bun_zipper.ply",
    ),
    File(
        "dragon",
        "7cfdc208d590d5fbfeca34a8f4dd5409109282da747ecd0e0b1e831098155db4",
        f"{STANFORD}/dragon/dragon_recon.tar.gz#dragon_recon/dragon_vrip.ply",
    ),
    File(
        "armadillo_50k",
        "aee9070c39e12a5fa3a05b3dcdf190389a5943969c6a7d39df2cffba104f06cd",
        f"{GITHUB}/NVlabs/instant-ngp/60dbb8e1c0e3859cf49d70fce7d499f56e4d13a0/data/sdf/armadillo.obj, half a turn "
        f"about y, scaled by 93.02 and fitted to the original vertices, {STANFORD}/armadillo/Armadillo.ply.gz",
    ),
    File(
        "armadillo_173k_resampled",
        "2f9dc2c1bca00b59ff3c1598882d9261263599b8bf872873372c1d4a838c60e5",
        make=partial(sampled, "armadillo_50k", 172_974, 11),
    ),
    File(
        "armadillo_100k_clean",
        "44e58c1e5b068e46a37889d9b513320530c9c277b1cceb7756a10ee6125738e9",
        make=partial(sampled, "armadillo_50k", 100_000, 12),
    ),
    *(
        File(f"armadillo_100k_noise_{level}", of, make=partial(noisy, "armadillo_100k_clean", "armadillo_50k", level))
        for level, of in zip(
            LEVELS,
            (
                "f28e8a614253ff165e7352b29b9186d6d7f8c43ccab05cb329e787c07432af09",
                "0887506461dc7874aa654b4311a0da267df4d3bed3d1e9e2af8f0de9bcda39cd",
                "357ae8b14416c4987d824094a7d2a399003b393d7916be315e04e100741e20ba",
                "4386c3dcc2df22486118887c1b4341799d32bdcadd6106c79ca5f5b72ac45a60",
            ),
            strict=True,
        )
    ),
    File(
        "modelnet_airplane_0001",
        "93ba9e0348a34bcfdc551a8aaef53c5723f214530e39a7ec1a16566a98b271a5",
        "airplane_0001.off of ModelNet40, https://modelnet.cs.princeton.edu",
    ),
    File(
        "modelnet_airplane_0001_2048",
        "04f48772791dcc0371d04f232cd4a3d527c584c74bfee83187a72a0c97bcab5a",
        make=partial(sampled, "modelnet_airplane_0001", 2_048, 31),
    ),
    File(
        "modelnet_toilet_0001",
        "5df2557fbc32bac6491c6e7742dbd6cc9f7c3b1a5b18be826fe7f09c6f73cec0",
        f"{GITHUB}/xingyu-first/go_mesh/eb211b5610e7ea9387a34ec526e5485dbb1ba0ae/data/toilet_0001.off",
    ),
    File(
        "modelnet_toilet_0001_2048",
        "263d647ff93724eb79bff17227ec0115f66a4bf53647602dda64a2dd992ce923",
        make=partial(sampled, "modelnet_toilet_0001", 2_048, 31),
    ),
    File(
        "drinking_glass_2048",
        "a46cffd17cad5e42cd48883a93061d3efd6e1f6ad7f1d81639e00c76b49f2d98",
        f"2,048 random points on {GITHUB}/dsparber/cocktail-mixing/df57d19612c6a12e19f22b079c88c96056ad2fcc/data/"
        "cocktail_glass.obj; which seed is not known",
    ),
    File(
        "nefertiti",
        "4194a8a803b0706b39d6c04a362831f3fcabe7eca67bc221478ba328e4056953",
        f"{GITHUB}/odedstein/meshes/49649a22cf07bb8afb8a1017775e5fe8448a5ac2/objects/nefertiti/nefertiti-lowres.obj",
    ),
    File(
        "sfm_angel",
        "3c0d4ee8e44a6db78416a41f41fa2a3e64b02315694e947b2133900e86aee783",
        "the angel of Nikolov and Madsen, GGG-BenchmarkSfM, https://data.mendeley.com/datasets/bzxk2n78s9, as "
        "decimated in github.com/pyvista/vtk-data",
    ),
    File(
        "sfm_bird_bath",
        "0c12c446445fb57912a13d466aa58516c6c0d944305340d13cf57f8d513e8978",
        "the bird bath of the same data set",
    ),
    File(
        "face_rangemap",
        "218156c258c46f71c66d2b575a80daaef555aca8c3f64754f07a561d111c6173",
        "the range map of a face among the samples of the package pymeshlab",
    ),
    File(
        "nyu_basement",
        "3936b4bed69836b9a455f5f07ca39f12a0addb91d95a93f3cc931f0adbcb1327",
        "the frame of NYU Depth V2 in the old test data of github.com/isl-org/Open3D; raw d is 351.3 / (1092.5 - d) "
        "metres, back-projected with f = 525 and centre (319.5, 239.5)",
    ),
    File(
        "tum_desk",
        "68bd732db5ebc83786d40a4eaa1099dbf7f6cd6f84c641f2ba1ba10b5adef91c",
        "the TUM RGB-D frame there, back-projected in the same way",
    ),
    File(
        "redwood_livingroom_frame",
        "1ca490a8cf27653126cb1fa9bfb0a5dcf7a647440c3ff124a446cdd5bf3637fd",
        "the first frame of the Redwood living room there, back-projected in the same way",
    ),
    File(
        "3dmatch_room_fragment",
        "0e248a4b4ec85aa7d47278aa4f49abdef7e1a8efd9809ec37c4d06220a359903",
        f"{GITHUB}/MIT-SPARK/TEASER-plusplus/e83aeabc8884d087f229dd96022494265b1010e1/examples/example_data/3dmatch_sample/"
        "cloud_bin_2.ply",
    ),
    File(
        "pcl_room_scan",
        "dc2a044d262546d3de115921c61338238494f553b6880d5e1f4ca8c55c375974",
        "room_scan1.pcd of github.com/PointCloudLibrary/data",
    ),
)
PAGES = {  # the clouds without which a page cannot be made
    "ablation": ("bunny",),
    "all_points": ("dragon",),
    "paper_differences": ("bunny", "dragon"),
    "paper_published": ("bunny", "dragon", *(file.name for file in OF_THE_PAPER)),
    "weighted_poisson": tuple(file.name for file in OF_WEIGHTED_POISSON),
    "paper_table1": ("dragon", "armadillo_173k_resampled", "armadillo_50k"),
    "paper_lucy": ("dragon",),
    "paper_noise": (
        *(f"armadillo_100k_noise_{level}" for level in LEVELS),
        "armadillo_173k_resampled",
        "armadillo_50k",
    ),
    "paper_scans": ("sfm_angel", "nefertiti", "sfm_bird_bath", "face_rangemap"),
    "paper_scenes": ("nyu_basement", "tum_desk", "redwood_livingroom_frame", "3dmatch_room_fragment", "pcl_room_scan"),
    "paper_modelnet": ("modelnet_airplane_0001_2048", "modelnet_toilet_0001_2048", "drinking_glass_2048"),
    "paper_registration_released": ("dragon",),
    "paper_registration": ("dragon", "3dmatch_room_fragment", "face_rangemap"),
}


def missing_for(page: str) -> list[File]:
    """Return the files that a page needs and that are not there."""
    return [file for file in FILES if file.name in PAGES.get(page, ()) and not file.path.is_file()]


def path_of(name: str) -> Path:
    """Return the path of a file; if it is not there, the script ends with its address."""
    (file,) = (file for file in FILES if file.name == name)
    if not file.path.is_file():
        print(f"expected {file.path}, found no such file. It can be had at: {file}", file=sys.stderr)
        raise SystemExit(2)
    return file.path


def hash_of(points: Array) -> str:
    """Return the SHA-256 of coordinates, (N, 3)."""
    return hashlib.sha256(np.ascontiguousarray(points, dtype="<f4").tobytes()).hexdigest()


def fetch(file: File) -> None:
    """Fetch a file from its address and write it as PLY."""
    address, _, member = file.origin.partition("#")
    with urlopen(address, timeout=60) as answer:
        content = answer.read()
    if member:
        with tarfile.open(fileobj=io.BytesIO(content)) as archive:
            content = archive.extractfile(member).read()
    elif address.endswith(".gz"):
        content = gzip.decompress(content)
    if file.stays:
        file.path.parent.mkdir(exist_ok=True)
        file.path.write_bytes(content)
        return
    part = file.path.with_name(f"{file.name}_fetched{Path(member or address).suffix}")
    part.write_bytes(content)
    try:
        gppcs.write_mesh(file.path, gppcs.read_mesh(part))
    except gppcs.errors.GppcsError:  # a cloud without faces
        gppcs.write(file.path, gppcs.read(part))
    finally:
        part.unlink()


def state(file: File, may_fetch: bool) -> str:
    """Make or fetch a file if it is missing and can be had; return what it is now."""
    how = "there"
    if not file.path.is_file():
        try:
            if file.make:
                gppcs.write(file.path, gppcs.PointCloud(file.make().astype(np.float32)))
                how = "made"
            elif may_fetch and "://" in file.origin and " " not in file.origin:
                fetch(file)
                how = "fetched"
        except (OSError, gppcs.errors.GppcsError) as error:
            how = str(error)
    if not file.path.is_file():
        return f"missing{'' if how == 'there' else f' ({how})'}: {file}"
    if file.stays or hash_of(gppcs.read(file.path).points) == file.hash:
        return how
    return f"{how}, but not the copy of the pages, whose hash is {file.hash}"


def main() -> None:
    """Print the state of each file, and the pages that cannot be made."""
    report.DATA.mkdir(parents=True, exist_ok=True)
    for file in FILES:
        print(f"{file.name}: {state(file, '--fetch' in sys.argv[1:])}")
    for page in PAGES:
        if files := missing_for(page):
            print(f"results/{page}.md cannot be made without {', '.join(file.name for file in files)}")


if __name__ == "__main__":
    main()
