"""The default method: a local, full-rank Gaussian process whose metric follows the surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gppcs.engine.stages import Stages
from gppcs.methods.method import Method, Selection, parameter

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from gppcs.gp.local.candidates import Finest
    from gppcs.gp.local.ranking import Criterion
    from gppcs.spatial.boxes import Each
    from gppcs.spatial.chunks import ChunkedPoints, ChunkedValues, Places
    from gppcs.surface.noise import Noise


# Memory in bytes, a little more than measured.
POINT = 24  # Coordinates of a point.
HASHED = 16  # For each point, while cells are looked up.
MEASURED = 100  # For each point of the sample.
RANKED = 300  # For each candidate.
TILED, TILED_KEPT = 400_000_000, 100  # Beyond a chunk, if tiles are on disk; and for each kept point.
STORED_CANDIDATE = 140  # On disk, for each candidate.
CELLS_ON_SLOPES = 1.5  # Occupied cells for each that a surface along the grid occupies.
SECONDS, SECONDS_KEPT = 1e-7, 1e-4  # For each point read, and for each point kept, on two cores.


@dataclass(frozen=True)
class LocalGP(Method):
    """Greedy choice where a local Gaussian process, whose metric follows the surface, is most uncertain.

    Examples
    --------
    >>> import gppcs
    >>> cloud = gppcs.sample("bracket", n_points=2000)
    >>> result = gppcs.simplify(cloud, n_points=100, method=gppcs.LocalGP(feature_weight=0.8))
    >>> len(result.cloud)
    100
    """

    name = "gp"
    summary = "a local Gaussian process: features kept, nothing left bare, a ranking"
    description = (
        "Chooses, one after another, the points where a local, full-rank Gaussian process is most uncertain. Its "
        "lengthscale is small where the surface is rough, and a change of the normal counts as distance, so points are "
        "dense on features. Above a feature weight of 0.5, the error of the predicted surface variation counts, too. "
        "The order is a ranking: its first points are a simplification of their number. The attributes of "
        'a point are "score", and "deviation": the standard deviation of the field when the point was chosen, relative '
        'to the prior one. The diagnostic "noise_in_spacings" is the distance of points from the surface, in '
        "target spacings: the standard deviation if it is Gaussian noise. It is 0 if too few points lie near each "
        "other to measure it. A value below 0.04 changes nothing, nor does detail such as vegetation."
    )
    source = "after GP-PCS, Algorithm 1; the field is our own, see docs/local-field.md"
    attributes = ("score", "deviation")
    ranks = True
    spacing = "The mean spacing: the number of points is the area of the surface, divided by the square of the spacing."

    feature_weight: float = parameter(
        0.5,
        "How much denser points are where the surface is rough, from 0, an even cover, to 1.",
        least=0,
        most=1,
    )
    lengthscale: float = parameter(
        1.5, "Lengthscale of the Matérn kernel, in desired spacings (docs/local-field.md).", least=0.1, most=100
    )
    neighbours: int = parameter(
        4, "Number of chosen points on which the field at a point is conditioned.", least=1, most=64
    )
    candidates: float = parameter(
        8.0, "Number of cells of the candidates' grid per squared target spacing.", least=3, most=1000
    )

    @property
    def criterion(self) -> Criterion:
        """The weights of the selection at this `feature_weight`.

        At the default, 0.5, surfaces rebuilt from the kept points have the smallest error (docs/experiments.md), and
        the error of the prediction has no weight. At 1 it has the weight that the paper gives it.

        Returns
        -------
        Criterion
        """
        from gppcs.gp.local.ranking import Criterion

        return Criterion(
            density_power=2.0 * self.feature_weight,
            normal_weight=2.8 * self.feature_weight,
            error_weight=max(0.0, 2.0 * self.feature_weight - 1.0) ** 2,
            lengthscale=self.lengthscale,
            neighbours=self.neighbours,
        )

    def __call__(self, points: NDArray[np.float64], n_points: int, stages: Stages | None = None) -> Selection:
        """Choose the points: survey, candidates, then the ranking in stages; see `Method.__call__`."""
        from gppcs.spatial.chunks import ChunkedPoints

        selection = self._chosen(ChunkedPoints.of(points), n_points, Stages.of(stages), points)
        assert selection is not None
        return selection

    def guided(
        self,
        points: NDArray[np.float64],
        n_points: int,
        fixed: int,
        weights: NDArray[np.float64] | None,
        stages: Stages,
    ) -> Selection:
        """Choose the points where the first `fixed` are not, with a density multiplied by weights; see `Method.guided`.

        The field is conditioned on the first points from the start.

        Parameters
        ----------
        points : (N, 3) array, float64
            Finite and without repeats.
        n_points : int
            M, from 1 to N - 1.
        fixed : int
            How many first points are chosen first.
        weights : (N,) array, float64, optional
            Above 0, but for points that are chosen anyway.
        stages : Stages
            Times the stages of a call.

        Returns
        -------
        Selection
        """
        import numpy as np

        from gppcs.gp.local.candidates import finest_candidates
        from gppcs.gp.local.guiding import behind_fixed, refinement
        from gppcs.gp.local.survey import survey
        from gppcs.spatial.chunks import ChunkedPoints, Places

        if weights is not None:  # those of points that are chosen anyway may be 0
            weights = np.maximum(weights, weights[weights > 0.0].min())
        chunked, density = ChunkedPoints.of(points), self.candidates * refinement(weights)
        area, noise, sharpness = survey(chunked, n_points, density, stages)
        finest = finest_candidates(chunked, n_points, area, density, sharpness, stages)
        if finest.thinned:
            first = Places(np.arange(fixed), points[:fixed], np.zeros(fixed, dtype=np.float32))
            finest = behind_fixed(finest, first, sharpness)
        else:
            places = Places(np.arange(len(points)), points, sharpness.dense(0, len(points)))
            finest = finest._replace(places=places)
        of_candidates = None if weights is None else weights[finest.places.rows]
        return self._ranked(finest, n_points, density, noise, stages, fixed, of_candidates)

    def guided_in_passes(
        self, points: ChunkedPoints, n_points: int, fixed: Places, weights: ChunkedValues | None, stages: Stages
    ) -> Selection | None:
        """Choose as `guided`, unless all points would be measured, or be candidates; see `Method.guided_in_passes`.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        n_points : int
            M, from 1 to N - 1.
        fixed : Places
            At most M of the points, without repeats.
        weights : ChunkedValues, optional
            One for each point, as shares of the largest one. Above 0, but for points that are chosen anyway.
        stages : Stages
            Times the stages of a call, and "weights".

        Returns
        -------
        Selection or None
        """
        from gppcs.gp.local.candidates import finest_candidates
        from gppcs.gp.local.guiding import ChunkedWeights, behind_fixed
        from gppcs.gp.local.survey import is_sampled, survey

        if not is_sampled(len(points), n_points):
            return None
        known = None if weights is None else ChunkedWeights(weights, stages)
        density = self.candidates * (1.0 if known is None else known.refinement)
        area, noise, sharpness = survey(points, n_points, density, stages)
        finest = finest_candidates(points, n_points, area, density, sharpness, stages)
        if not finest.thinned:
            return None
        finest = behind_fixed(finest, fixed, sharpness)
        of_candidates = None if known is None else known.at(finest.places.rows)
        return self._ranked(finest, n_points, density, noise, stages, len(fixed.rows), of_candidates)

    def in_passes(self, points: ChunkedPoints, n_points: int, stages: Stages) -> Selection | None:
        """Choose the points, unless all of them would be measured, or be candidates; see `Method.in_passes`.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        n_points : int
            M, from 1 to N - 1.
        stages : Stages
            Times "sample", "tree", "noise", "candidates", "features" and "greedy selection".

        Returns
        -------
        Selection or None
        """
        from gppcs.gp.local.survey import is_sampled

        return self._chosen(points, n_points, stages) if is_sampled(len(points), n_points) else None

    def at_spacing(self, points: NDArray[np.float64], spacing: float, stages: Stages) -> Selection:
        """Choose so many points that their mean spacing on the surface is as wanted; see `Method.at_spacing`.

        Parameters
        ----------
        points : (N, 3) array, float64
            Finite and without repeats.
        spacing : float
            In the unit of the points.
        stages : Stages
            Times "tree" and the stages of a call.

        Returns
        -------
        Selection
        """
        import numpy as np

        from gppcs.spatial.chunks import ChunkedPoints

        count = self.count_at_spacing(ChunkedPoints.of(points), spacing, stages)
        return self(points, count, stages) if count < len(points) else Selection(np.arange(len(points)), ranked=False)

    def count_at_spacing(self, points: ChunkedPoints, spacing: float, stages: Stages) -> int:
        """Return how many points have a mean spacing on the surface, of which a sample measures the area.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        spacing : float
            In the unit of the points.
        stages : Stages
            Times the stages of `surface_area`.

        Returns
        -------
        int
        """
        wanted = self.surface_area(points, stages) / spacing / spacing
        return max(1, round(min(wanted, len(points))))

    def surface_area(self, points: ChunkedPoints, stages: Stages) -> float:
        """Return the area of the surface, as a sample of the points measures it.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        stages : Stages
            Times "sample" and "tree". A step of the first is a point read.

        Returns
        -------
        float
            In squared units of the points.
        """
        from gppcs.gp.local.survey import sample
        from gppcs.spatial.cells import first_occurrences
        from gppcs.spatial.kdtree import KdTree
        from gppcs.spatial.spacing import surface_area

        with stages("sample", len(points)) as advanced:
            _, places = sample(points, 1, advanced)
        with stages("tree"):
            return surface_area(KdTree.build(places[first_occurrences(places)]))

    def memory(self, n: int, n_points: int) -> int:
        """Return about how much memory a call takes, beyond the points themselves.

        Parameters
        ----------
        n : int
            N, the number of points.
        n_points : int
            M, the number of points to keep.


        Returns
        -------
        int
            Bytes.
        """
        from gppcs.gp.local.survey import sample_size

        return HASHED * n + MEASURED * min(n, sample_size(n_points)) + self._memory_of_ranking(n, n_points)

    def memory_in_passes(self, n: int, n_points: int) -> int:
        """Return about how much memory `in_passes` takes, beyond one chunk of points.

        Parameters
        ----------
        n : int
            N, the number of points.
        n_points : int
            M, the number of points to keep.


        Returns
        -------
        int
            Bytes. All coordinates count if a sample would be nearly all points.
        """
        from gppcs.gp.local.survey import is_sampled, sample_size

        if not is_sampled(n, n_points):
            return 3 * POINT * n + self.memory(n, n_points)
        return MEASURED * sample_size(n_points) + self._memory_of_ranking(n, n_points)

    def memory_of_weights(self, n: int, n_points: int) -> int:
        """Return about how much more memory than without weights a call takes at most; see `Method.memory_of_weights`.

        Parameters
        ----------
        n : int
            N, the number of points.
        n_points : int
            M, the number of points to keep.

        Returns
        -------
        int
            Bytes.
        """
        from gppcs.gp.local.guiding import FINEST

        return self._memory_of_ranking(n, round(FINEST * n_points)) - self._memory_of_ranking(n, n_points)

    def in_tiles(
        self, points: ChunkedPoints, n_points: int, folder: Path, stages: Stages, each: Each = map
    ) -> Selection:
        """Choose the points with all but one tile on disk; see `Method.in_tiles` and `gppcs.gp.tiled`.

        Parameters
        ----------
        points : ChunkedPoints
            N finite points, which may repeat each other.
        n_points : int
            M, from 1 to N - 1.
        folder : path
            An empty folder, or that of an interrupted call.
        stages : Stages
            Times "sample", "boxes", "survey", "candidates", "features" and "greedy selection".
        each : callable, optional
            Applies a function to each tile, like `map`.

        Returns
        -------
        Selection
        """
        import numpy as np

        from gppcs.gp.tiled.ranking import rank_in_tiles
        from gppcs.spatial.chunks import first_repeats

        ranking, noise = rank_in_tiles(points, n_points, self.criterion, self.candidates, folder, stages, each)
        repeats = first_repeats(ranking.indices, n_points)
        scores, deviations = (np.pad(values, (0, len(repeats))) for values in (ranking.scores, ranking.deviations))
        return Selection(
            np.concatenate([ranking.indices, repeats]),
            {"noise_in_spacings": noise.level / noise.spacing if noise.spacing > 0.0 else 0.0},
            attributes={"score": scores, "deviation": deviations},
        )

    def memory_in_tiles(self, n: int, n_points: int) -> int:
        """Return about how much memory `in_tiles` takes, beyond one chunk of points; see `Method.memory_in_tiles`.

        Parameters
        ----------
        n : int
            N, the number of points.
        n_points : int
            M, the number of points to keep.

        Returns
        -------
        int
            Bytes.
        """
        return TILED + TILED_KEPT * n_points

    def disk_in_tiles(self, n: int, n_points: int) -> int:
        """Return about how much disk space `in_tiles` takes; see `Method.disk_in_tiles`.

        Parameters
        ----------
        n : int
            N, the number of points.
        n_points : int
            M, the number of points to keep.

        Returns
        -------
        int
            Bytes.
        """
        from gppcs.spatial.stored import BYTES_ON_DISK

        return BYTES_ON_DISK * n + STORED_CANDIDATE * min(n, round(CELLS_ON_SLOPES * self.candidates * n_points))

    def seconds(self, n: int, n_points: int) -> float:
        """Return about how long a call takes on two cores.

        Parameters
        ----------
        n : int
            N, the number of points, counted once for each pass over them.
        n_points : int
            M, the number of points to keep.


        Returns
        -------
        float
        """
        return SECONDS * n + SECONDS_KEPT * n_points

    def _memory_of_ranking(self, n: int, n_points: int) -> int:
        return RANKED * min(n, round(CELLS_ON_SLOPES * self.candidates * n_points))

    def _chosen(
        self, points: ChunkedPoints, n_points: int, stages: Stages, every: NDArray[np.float64] | None = None
    ) -> Selection | None:
        """Choose the points; return None if all should be candidates, unless `every` holds them, (N, 3)."""
        import numpy as np

        from gppcs.gp.local.candidates import finest_candidates
        from gppcs.gp.local.survey import survey
        from gppcs.spatial.chunks import Places

        area, noise, sharpness = survey(points, n_points, self.candidates, stages)
        finest = finest_candidates(points, n_points, area, self.candidates, sharpness, stages)
        if not finest.thinned:
            if every is None:
                return None
            n = len(every)
            finest = finest._replace(places=Places(np.arange(n), every, sharpness.dense(0, n)))
        del sharpness  # to free its memory
        return self._ranked(finest, n_points, self.candidates, noise, stages)

    def _ranked(
        self,
        finest: Finest,
        n_points: int,
        density: float,
        noise: Noise,
        stages: Stages,
        fixed: int = 0,
        weights: NDArray[np.float64] | None = None,
    ) -> Selection:
        """Choose among the candidates of the last stage, of which the first are fixed; the weights are theirs."""
        from gppcs.gp.local.candidates import nested_candidates
        from gppcs.gp.local.guiding import after_fixed
        from gppcs.gp.local.ranking import rank

        rows, candidates = finest.places.rows, nested_candidates(finest, n_points, density, stages)
        if fixed:
            candidates = after_fixed(candidates, fixed)
        ranking = rank(finest.places.points, candidates, self.criterion, noise, stages, fixed, weights)
        return Selection(
            rows[ranking.indices],
            {"noise_in_spacings": noise.level / noise.spacing if noise.spacing > 0.0 else 0.0},
            attributes={"score": ranking.scores, "deviation": ranking.deviations},
        )
