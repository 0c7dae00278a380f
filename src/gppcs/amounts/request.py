"""The class `Request`: what is asked of a simplification, checked as far as that is possible without the cloud."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from gppcs.amounts.quotas import Quota, quotas_of
from gppcs.clouds.expressions import Expression
from gppcs.clouds.quantities import Amount, metres_of
from gppcs.clouds.ranges import weights_of_detail
from gppcs.errors import ParameterError, flag, nearest_name, one_of, shown, whole_number
from gppcs.methods import DEFAULT, METHODS, Feature, Method
from gppcs.methods.parameters import parameters_of, with_settings

FEATURES = {
    Feature.SPACING: "takes a spacing",
    Feature.KEEP: "keeps given points",
    Feature.WEIGHT: "weighs points",
    Feature.DETAIL: "looks at attributes",
    Feature.RANKING: "ranks its points",
    Feature.DENOISE: "can denoise its points",
    Feature.SCORES: "scores its points",
}  # of a method, in words


@dataclass(frozen=True)
class Request:
    """What is asked of a simplification, whatever the cloud: the arguments of `simplify` with these names, checked."""

    method: Method
    amount: Amount
    unit: str | None
    keep: Any
    weight: Any
    detail: Mapping[str, float]
    quotas: tuple[Quota, ...]
    group: str | None
    invalid: str
    normals: bool
    scores: bool
    drop_outliers: bool
    denoise: bool  # Whether the method moves its points onto the surface below their noise
    guided: bool  # Whether anything is asked of single points, which `Guide` looks up

    @classmethod
    def of(
        cls,
        *,
        ratio: float | str | None = None,
        n_points: int | str | None = None,
        tolerance: float | str | None = None,
        spacing: float | str | None = None,
        max_gap: float | str | None = None,
        unit: str | None = None,
        keep: Any = None,
        weight: Any = None,
        detail: Any = None,
        quota: Any = None,
        group: str | None = None,
        method: str | Method = DEFAULT,
        seed: int | None = None,
        invalid: str = "error",
        normals: bool = False,
        scores: bool = False,
        drop_outliers: bool = False,
        denoise: bool = False,
    ) -> Request:
        """Check the arguments of `simplify`, as far as that is possible without the cloud."""
        amount = Amount.of(ratio, n_points, tolerance, spacing, max_gap)
        chosen = method_of(method, seed)
        if flag("denoise", denoise):
            require(chosen, Feature.DENOISE)
            chosen = with_settings(chosen, {"denoise": True})
        counted = {} if detail is None else weights_of_detail(detail)
        quotas = () if quota is None else quotas_of(quota)
        if group is not None and not isinstance(group, str):
            raise ParameterError(f"expected group to be the name of an attribute, found {shown(group)}")
        _check_supported(chosen, amount, keep, weight, counted, quotas, group)
        denoise = Feature.DENOISE in chosen.supports and chosen.moves_points
        if denoise:
            _check_denoised(amount, keep, quotas, group)
        if unit is not None:
            metres_of(unit, None)
        if isinstance(keep, str):
            Expression.of(keep)
        by_name = counted or quotas or group or chosen.reads_attribute
        if flag("scores", scores):
            require(chosen, Feature.SCORES)
        return cls(
            chosen, amount, unit, keep, weight, counted, quotas, group,
            one_of("invalid", invalid, ("error", "drop")),
            flag("normals", normals), scores, flag("drop_outliers", drop_outliers), denoise,
            keep is not None or weight is not None or bool(by_name),
        )  # fmt: skip

    @property
    def whole(self) -> str | None:
        """The argument for which all points have to be in memory, if any."""
        arrays = {name: getattr(self, name) for name in ("keep", "weight")}
        reasons = {
            "tolerance": self.amount.tolerance is not None,
            "max_gap": self.amount.max_gap is not None,
            "denoise": self.denoise,
            "normals": self.normals,
            **{name: value is not None and not isinstance(value, str) for name, value in arrays.items()},
        }
        return next((name for name, given in reasons.items() if given), None)


def require(method: Method, feature: Feature) -> None:
    """Check that a method can do what one of `FEATURES` says."""
    if feature not in method.supports:
        others = " or ".join(repr(name) for name, known in METHODS.items() if feature in known.supports)
        raise ParameterError(f"expected a method that {FEATURES[feature]}, found {method.name!r}; use {others}")


def _check_denoised(amount: Amount, keep: object, quotas: object, group: str | None) -> None:
    """Check that what is asked for can be had of denoised points."""
    asked = {
        "tolerance": amount.tolerance is not None,  # the points themselves are farther from the surface
        "max_gap": amount.max_gap is not None,
        "keep": keep is not None,
        "quota": quotas,
        "group": group is not None,
    }
    for name, given in asked.items():
        if given:
            raise ParameterError(f"expected denoise without {name}, found both")


def _check_supported(
    method: Method, amount: Amount, keep: object, weight: object, detail: object, quotas: object, group: str | None
) -> None:
    """Check that a method can do what is asked for."""
    asked = {
        Feature.SPACING: amount.spacing is not None,
        Feature.KEEP: keep is not None,
        Feature.WEIGHT: weight is not None,
        Feature.DETAIL: detail,
        Feature.RANKING: quotas or group is not None,
    }
    for feature, given in asked.items():
        if given:
            require(method, feature)
    if amount.spacing is not None and (keep is not None or weight is not None):
        raise ParameterError(
            "expected a number, a share, a tolerance or a largest gap with points to keep or weights, found a spacing"
        )
    if (quotas or group) and (amount.known_count(1) is None or amount.max_gap is not None):
        raise ParameterError(
            "expected a number or a share of the points with quotas or groups, and no tolerance, spacing or largest gap"
        )
    if quotas and group:
        raise ParameterError("expected either quotas or a group, found both; ask for one")


def method_of(method: Any, seed: int | None = None, settings: Mapping[str, Any] | None = None) -> Method:
    """Return the method of that name, or the method itself, with a seed and other parameters."""
    if isinstance(method, str):
        if method not in METHODS:
            raise ParameterError(f"there is no method {method!r}{nearest_name(method, METHODS)}")
        method = METHODS[method]()
    if not isinstance(method, Method):
        raise ParameterError(f"expected the name of a method or a method such as SpectralGP(), found {shown(method)}")
    if settings:
        method = with_settings(method, settings)
    if seed is not None and "seed" in parameters_of(method):
        return replace(method, seed=seed)
    if seed is not None:
        whole_number("the seed", seed, 0)
    return method
