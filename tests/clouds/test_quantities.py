"""Lengths with units."""

import numpy as np
import pytest

import gppcs
from gppcs.clouds.quantities import Length, units_of


@pytest.mark.parametrize(
    ("given", "unit", "expected"),
    [
        (0.5, None, 0.5),
        ("0.5", None, 0.5),
        ("2e-3", None, 0.002),
        ("0.5mm", "m", 0.0005),
        ("5 cm", "mm", 50.0),
        ("1ft", "m", 0.3048),
        ("0.02%", None, 0.002),
        (np.float32(0.5), "m", 0.5),
    ],
)
def test_a_length_in_the_unit_of_the_cloud(given, unit, expected):
    length = Length.from_value("tolerance", given)
    assert length.in_cloud(10.0, units_of(unit, None)) == pytest.approx(expected, rel=1e-12)


def test_the_coordinate_system_of_a_file_tells_the_unit(two_systems):
    cloud = gppcs.read(two_systems[0])
    with pytest.raises(gppcs.InputError, match="does not say in which unit"):
        gppcs.simplify(cloud, spacing="50cm", method="fps")
    assert (
        gppcs.simplify(cloud, spacing="50cm", unit="m", method="fps").indices
        == gppcs.simplify(cloud, spacing=0.5, method="fps").indices
    ).all()
