"""The options of a simplification: one dataclass, which `gppcs.simplify` and `gppcs simplify` fill."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from gppcs.errors import ParameterError, file_path, flag, nearest_name, one_of, shown
from gppcs.methods import DEFAULT, METHODS, Feature, Method
from gppcs.methods.parameters import with_settings

if TYPE_CHECKING:  # the help of the command needs the texts below, but no NumPy
    from numpy.typing import ArrayLike

    from gppcs.amounts.quotas import Quota
    from gppcs.clouds.quantities import Length, Tolerance

Order: TypeAlias = Literal["importance", "input", "gps_time"]


def _option(default: Any, text: str, for_files: bool = False) -> Any:
    """Declare an option with its help text; some are only for clouds in files."""
    return field(default=default, metadata={"help": text, "for_files": for_files})


@dataclass(frozen=True, eq=False, kw_only=True)
class Options:
    """Options of a simplification, validated as far as possible without the cloud."""

    ratio: float | str | None = _option(None, "Fraction of the points to keep: 0.03 or 3%.")
    n_points: int | str | None = _option(None, "Number of points to keep, such as 5000 or 1.5M.")
    tolerance: float | str | None = _option(
        None,
        "Keep the fewest points whose surface is that near to all points but outliers: 0.5, 0.5mm, 0.02% of the "
        "diagonal, or 2mm:p95 (:mean, :rms, :max).",
    )
    spacing: float | str | None = _option(
        None, "Keep as many points as have this spacing, such as 5cm (gp, fps, sample-elimination, voxel)."
    )
    max_gap: float | str | None = _option(None, "Add points until each original one has a kept one within this length.")
    unit: str | None = _option(None, "Unit of the coordinates, such as m, if the file tells none.")
    keep: str | ArrayLike | None = _option(
        None, "Keep all points that meet a condition, such as 'classification == 6' (gp, fps, random)."
    )
    weight: str | ArrayLike | None = _option(
        None, "Multiply the density by an attribute or a formula, such as 1/(x*x + y*y) (gp)."
    )
    detail: str | Mapping[str, float] | None = _option(
        None, "Let an attribute count beside the shape: rgb, a number or classes (gp)."
    )
    quota: Mapping[str, float | str] | None = _option(
        None, "Keep exactly this number or fraction of points that meet a condition, such as 'z > 6: 10%'."
    )
    method: str | Method = _option(DEFAULT, "The method: its name, or in Python an instance with other parameters.")
    invalid: Literal["error", "drop"] = _option("error", "Whether invalid coordinates are an error, or dropped.")
    drop_outliers: bool = _option(False, "First drop points that neither their neighbours nor the surface explain.")
    normals: bool = _option(False, "Add normals, estimated from all points of the input.")
    scores: bool = _option(False, "Add the score and deviation of each point (gp).")
    order: Order = _option("importance", "Order of the result: importance, input or gps_time.")
    levels: str | Sequence[float | int | str] | None = _option(
        None,
        "Several sizes, such as 10%,3%,1%, each the start of the next: files, with {level} in the name, or an "
        "attribute level.",
    )
    index: bool = _option(False, "Add the index of each kept point among those read.")
    rank: bool = _option(False, "Add the place of each point in the order chosen.")
    mark: str | None = _option(None, "Write all points, with an attribute of this name that is 1 for kept ones.")
    memory: int | str | None = _option(
        None, "How much memory to use, such as 2GB; by default half of what is free.", True
    )
    workers: str | Executor | None = _option(
        None, "Share the work among workers of Dask, such as tcp://10.0.0.5:8786.", True
    )
    scratch: str | os.PathLike[str] | None = _option(
        None, "An existing folder for temporary files, by default the system's.", True
    )

    def __post_init__(self) -> None:
        from gppcs.clouds.expressions import Expression
        from gppcs.clouds.quantities import units_of

        one_of("invalid", self.invalid, ("error", "drop"))
        one_of("order", self.order, get_args(Order))
        for name in ("drop_outliers", "normals", "scores", "index", "rank"):
            object.__setattr__(self, name, flag(name, getattr(self, name)))
        self._check_size()
        self._check_features()
        if self.unit is not None:
            units_of(self.unit, None)
        if isinstance(self.keep, str):
            Expression.from_text(self.keep)
        _ = self.memory_limit
        if self.scratch is not None:
            file_path(self.scratch)
        _check_workers(self.workers)

    def __getstate__(self) -> dict[str, Any]:
        """Return what a worker needs, to which no executor can be sent."""
        return {**vars(self), "workers": None}

    @cached_property
    def size(self) -> float | int | None:
        """The fraction of the points to keep (float) or their number (int), if one of them is asked for."""
        from gppcs.clouds.quantities import count_of, ratio_of

        if self.sizes:
            return self.sizes[-1] if self.sizes[-1] < 1 else int(self.sizes[-1])
        if self.ratio is not None:
            return ratio_of("ratio", self.ratio)
        return None if self.n_points is None else count_of("n_points", self.n_points)

    @cached_property
    def sizes(self) -> tuple[float, ...]:
        """The sizes of the levels, from coarse to fine; none without levels."""
        from gppcs.amounts.order import level_sizes

        return () if self.levels is None else level_sizes(self.levels)

    def count(self, n: int) -> int | None:
        """Return M for a cloud of N = n points, if that tells it."""
        if isinstance(self.size, float):
            return max(1, round(self.size * n))
        return None if self.size is None else min(self.size, n)

    @cached_property
    def max_error(self) -> Tolerance | None:
        """The error that is allowed, if there is one."""
        from gppcs.clouds.quantities import Tolerance

        return None if self.tolerance is None else Tolerance.from_value(self.tolerance)

    @cached_property
    def lengths(self) -> Mapping[str, Length]:
        """The spacing and the largest gap that are asked for."""
        from gppcs.clouds.quantities import Length

        names = ("spacing", "max_gap")
        return {name: Length.from_value(name, getattr(self, name)) for name in names if getattr(self, name) is not None}

    @cached_property
    def algorithm(self) -> Method:
        """The method."""
        return method_of(self.method)

    @cached_property
    def denoises(self) -> bool:
        """Whether points are moved onto the surface below their noise."""
        return Feature.DENOISE in self.algorithm.supports and self.algorithm.moves_points

    @cached_property
    def details(self) -> Mapping[str, float]:
        """The attributes that count beside the shape, with their weights."""
        from gppcs.clouds.ranges import weights_of_detail

        return {} if self.detail is None else weights_of_detail(self.detail)

    @cached_property
    def quotas(self) -> tuple[Quota, ...]:
        """How many points meet conditions."""
        from gppcs.amounts.quotas import quotas_of

        return () if self.quota is None else quotas_of(self.quota)

    @cached_property
    def memory_limit(self) -> int | None:
        """How many bytes the process may hold, if that is limited."""
        from gppcs.clouds.quantities import bytes_of

        return None if self.memory is None else bytes_of(self.memory)

    @property
    def constrains_points(self) -> bool:
        """Whether anything is asked of single points; see `Constraints`."""
        by_name = self.details or self.quotas or self.algorithm.reads_attribute
        return self.keep is not None or self.weight is not None or bool(by_name)

    def check_in_memory(self) -> None:
        """Check that no option is given that is only for clouds in files."""
        for option in fields(self):
            if option.metadata["for_files"] and getattr(self, option.name) is not option.default:
                raise ParameterError(f"expected `{option.name}` with a cloud in files, found one in memory")

    def _check_size(self) -> None:
        """Check that one option decides how many points are kept, beside `max_gap`, and that lengths are some."""
        sizes = ("ratio", "n_points", "tolerance", "spacing", "levels")
        names = [f"`{name}`" for name in sizes if getattr(self, name) is not None]
        if len(names) > 1 or not (names or self.max_gap is not None):
            actual = " and ".join(names) or "none"
            raise ParameterError(
                "expected one of `ratio`, `n_points`, `tolerance`, `spacing` and `max_gap`, found "
                f"{actual}; a ratio of 0.1 keeps a tenth of the points"
            )
        _ = self.size, self.max_error, self.lengths

    def _check_features(self) -> None:
        """Check that the method can do what is asked for, and that the options go together."""
        features = {
            Feature.SPACING: self.spacing is not None,
            Feature.KEEP: self.keep is not None,
            Feature.WEIGHT: self.weight is not None,
            Feature.DETAIL: bool(self.details),
            Feature.RANKING: bool(self.quotas or self.sizes or self.rank),
            Feature.SCORES: self.scores,
        }
        for feature, is_needed in features.items():
            if is_needed:
                require(self.algorithm, feature)
        if self.spacing is not None and (self.keep is not None or self.weight is not None):
            raise ParameterError("expected `spacing` without `keep` and `weight`, found both")
        if self.quotas and (self.size is None or self.max_gap is not None):
            raise ParameterError(
                "expected `ratio` or `n_points` with `quota`, without `spacing`, `tolerance` and `max_gap`"
            )
        alone = {"levels": ("max_gap", "quota"), "mark": ("levels", "index", "rank", "normals", "scores")}
        for name, others in alone.items():
            for other in others if getattr(self, name) is not None else ():
                if getattr(self, other):
                    raise ParameterError(f"expected `{name}` without `{other}`, found both")
        if self.mark is not None and self.order != "importance":
            raise ParameterError("expected `mark` without `order`, found both")
        if self.mark == "":
            raise ParameterError("expected `mark` with the name of an attribute, found nothing")
        if self.mark is not None and self.algorithm.moves_points:
            raise ParameterError(
                "expected `mark` with a method that moves no points, as all are written where they were"
            )
        refused = ("tolerance", "max_gap", "keep", "quota")  # of denoised points, all are off the surface
        for name in refused if self.denoises else ():
            if getattr(self, name) is not None:
                raise ParameterError(f"expected `denoise` without `{name}`, found both")


def require(method: Method, feature: Feature) -> None:
    """Check that a method has a feature."""
    if feature in method.supports:
        return
    alternatives = " or ".join(repr(name) for name, other in METHODS.built_in.items() if feature in other.supports)
    raise ParameterError(f"expected a method that supports {feature}, found {method.name!r}; use {alternatives}")


def method_of(method: Any, settings: Mapping[str, Any] | None = None) -> Method:
    """Return the method of that name, or the method itself, with other parameters."""
    if isinstance(method, str):
        if method not in METHODS:
            raise ParameterError(f"there is no method {method!r}{nearest_name(method, METHODS.names())}")
        method = METHODS[method]()
    if not isinstance(method, Method):
        raise ParameterError(f"expected the name of a method or a method such as SpectralGP(), found {shown(method)}")
    return with_settings(method, settings) if settings else method


def _check_workers(workers: Any) -> None:
    """Check that workers are the address of a scheduler, or an executor."""
    is_address = isinstance(workers, str) and "://" in workers
    if not (workers is None or is_address or isinstance(workers, Executor)):
        raise ParameterError(
            "expected `workers` to be the address of a Dask scheduler such as tcp://10.0.0.5:8786, or an executor of "
            f"concurrent.futures, found {shown(workers)}; the threads of this process are set by --threads, set_threads"
        )
