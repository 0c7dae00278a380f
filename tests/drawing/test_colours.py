import sys

import numpy as np
import pytest

from gppcs.drawing.colours import colour_scale, colours_of
from gppcs.engine.extras import require_matplotlib
from gppcs.errors import MissingExtraError


def test_the_scale_ends_at_the_largest_98th_percentile():
    values = np.linspace(0.0, 1.0, 101)
    assert colour_scale([values]).get_clim() == pytest.approx((0.0, 0.98))
    assert colour_scale([values, 3.0 * values, 2.0 * values]).get_clim() == pytest.approx((0.0, 2.94))
    values[-1] = 1e6
    assert colour_scale([values]).get_clim() == pytest.approx((0.0, 0.98))


@pytest.mark.parametrize(
    ("values", "limits"),
    [
        (np.full(5, np.nan), (0.0, 1.0)),
        (np.zeros(5), (0.0, 1.0)),
        (np.array([-1.0, np.inf, np.nan, 1.0]), (-1.0, 0.96)),
    ],
)
def test_there_is_always_a_scale(values, limits):
    scale = colour_scale([values])
    assert scale.get_clim() == pytest.approx(limits)
    assert np.isfinite(colours_of(scale, values)).all()


def test_a_value_that_is_not_a_number_is_grey():
    red, green, blue = colours_of(colour_scale([np.arange(3.0)]), np.array([np.nan]))[0]
    assert red == green == blue < 0.7


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"needs matplotlib.*the extra picture.*: pip install 'matplotlib>="):
        require_matplotlib()
