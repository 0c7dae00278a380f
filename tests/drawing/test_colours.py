import numpy as np
import pytest

from gppcs.drawing.colours import Legend

VALUES = np.linspace(0.0, 1.0, 101)


@pytest.mark.parametrize(
    ("clouds", "ends"),
    [
        ([VALUES], (0.0, 0.98)),
        ([VALUES, 3.0 * VALUES, 2.0 * VALUES], (0.0, 2.94)),  # the largest 98th percentile
        ([np.append(VALUES[:-1], 1e6)], (0.0, 0.98)),
        ([np.full(5, np.nan)], (0.0, 1.0)),
        ([np.zeros(5)], (0.0, 1.0)),
        ([np.array([-1.0, np.inf, np.nan, 1.0])], (-1.0, 0.96)),
    ],
)
def test_the_scale_has_ends_that_few_extreme_values_do_not_move(clouds, ends):
    legend = Legend.of_amounts(clouds)
    assert legend.scale.get_clim() == pytest.approx(ends)
    assert np.isfinite(legend.colours_of(clouds[0])).all()


def test_a_value_that_is_not_a_number_is_grey():
    ((red, green, blue),) = Legend.of_amounts([np.arange(3.0)]).colours_of(np.array([np.nan]))
    assert red == green == blue < 0.7
