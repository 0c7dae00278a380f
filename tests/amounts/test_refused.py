"""What `gppcs.simplify` refuses, with what was expected and found."""

import math

import numpy as np
import pytest

import gppcs

CLOUD = gppcs.sample("bracket", n_points=4000)
AMOUNTS = {"n_points", "ratio", "tolerance", "spacing", "max_gap"}
QUOTA = {"nz > 0": 3}
PARAMETERS = [  # with a number of points, unless they are an amount themselves
    ({"n_points": None}, "`tolerance`, `spacing` and `max_gap`, found none"),
    ({"ratio": 0.5, "n_points": 5}, "found `ratio` and `n_points`"),
    ({"ratio": 0}, "a ratio above 0 and at most 1, found 0"),
    ({"ratio": 3}, "found 3; for 3 percent, write 0.03$"),
    ({"n_points": 0}, "number of points to be a whole number from 1 on, found 0"),
    ({"ratio": "300%"}, "at most 100%, found '300%'$"),
    ({"tolerance": "0,5mm"}, "found ',5mm' in '0,5mm'; did you mean 'mm'"),
    ({"spacing": "1,500.5 m"}, "a length, such as 0.5"),
    ({"tolerance": 0}, "above 0, found 0"),
    ({"tolerance": -1}, "found -1"),
    ({"tolerance": math.nan}, "a length, such as 0.5, 0.5mm or 0.02%, found nan"),
    ({"tolerance": math.inf}, "above 0, found inf"),
    ({"tolerance": "half"}, "a length, such as .*, found 'half'"),
    ({"tolerance": "1 mmm"}, "a unit, found 'mmm' in '1 mmm'; did you mean 'mm'?"),
    ({"tolerance": "1" + "m" * 9999}, r"a unit, found 'm{79}\.\.\. in '1m{78}\.\.\."),
    ({"tolerance": True}, "a length, .*found True"),
    ({"tolerance": 1, "unit": "parsec"}, "the name of a unit of length, found 'parsec'"),
    ({"tolerance": 1, "n_points": 5}, "`max_gap`, found `n_points` and `tolerance`"),
    ({"tolerance": "1:p99"}, "`tolerance` to end in :mean or :rms or :p95 or :max, found '1:p99'"),
    ({"method": gppcs.SpectralGP}, "expected the name of a method"),
    ({"method": "fpss"}, "did you mean 'fps'"),
    ({"method": "FPS"}, "did you mean 'fps'"),
    ({"invalid": "ignore"}, "`invalid` to be 'error' or 'drop', found 'ignore'"),
    ({"spacing": 4.0, "method": "hc"}, "expected a method that supports spacing, found 'hc'; use 'gp' or 'fps'"),
    ({"scores": True, "method": "fps"}, "expected a method that supports scores, found 'fps'; use 'gp'"),
    ({"detail": "nx", "method": "fps"}, "expected a method that supports detail, found 'fps'; use 'gp'"),
    ({"keep": [1], "method": "voxel"}, "expected a method that supports keep, found 'voxel'; use 'gp' or 'fps'"),
    ({"keep": [4000]}, "indices from 0 to 3999, found 4000"),
    ({"keep": [-1]}, "found -1"),
    ({"keep": [True]}, "a mask of the 4,000 points"),
    ({"keep": [0.5]}, "a mask of the 4,000 points, or indices"),
    ({"keep": "nz >"}, "at its end"),
    ({"weight": [1.0]}, "a number for each of the 4,000 points"),
    ({"quota": "nz > 0"}, "expected `quota` to be a mapping"),
    ({"quota": {"nz > 0": -1}}, "quota"),
    ({"quota": QUOTA, "method": "wlop"}, "a method that supports ranking"),
    ({"quota": QUOTA, "tolerance": 0.1}, "expected `ratio` or `n_points` with `quota`"),
    ({"quota": QUOTA, "n_points": 9, "max_gap": 0.1}, "expected `ratio` or `n_points` with `quota`"),
    ({"workers": "dask"}, "or an executor of concurrent.futures, found 'dask'"),
    ({"workers": 2}, "found 2; the threads of this process are set by"),
    ({"workers": "tcp://a:1"}, "expected `workers` with a cloud in files, found one in memory"),
    ({"memory": "lots"}, "an amount of memory such as 4GB or 512MB, found 'lots'"),
]
INPUTS = [
    ({"tolerance": "0.5mm"}, r"does not say in which unit.*how much 0\.5mm is; give `unit`"),
    ({"keep": range(6)}, "6 points are to be kept .* only 5 points are asked for"),
    ({"keep": "nzz > 0"}, "at character 1 .* no attribute 'nzz'; did you mean 'nz'?"),
    ({"keep": "nz > 9"}, "expected points with nz > 9 to keep, found none; .* omit `keep`"),
    ({"weight": -np.ones(4000)}, "finite weights from 0 on, found -1 and 3,999 more"),
    ({"weight": np.full(4000, np.inf)}, "found inf and 3,999 more"),
    ({"weight": np.zeros(4000)}, "at least one weight above 0, found only 0"),
    ({"weight": np.arange(4000) < 3}, "at least 5 points of a weight above 0, found 3"),
    ({"weight": "nzz"}, "no attribute 'nzz'; did you mean 'nz'?"),
]


@pytest.mark.parametrize(
    ("error", "wanted", "message"),
    [*((gppcs.ParameterError, *row) for row in PARAMETERS), *((gppcs.InputError, *row) for row in INPUTS)],
)
def test_what_cannot_be_asked_for_is_refused(error, wanted, message):
    amount = {} if AMOUNTS & set(wanted) else {"n_points": 5}
    with pytest.raises(error, match=message):
        gppcs.simplify(CLOUD, **amount, **wanted)
