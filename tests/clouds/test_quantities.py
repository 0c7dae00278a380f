"""Lengths with units."""

import numpy as np
import pytest

import gppcs
from gppcs.clouds.quantities import Length, metres_of
from gppcs.io.las_header import metres_of_wkt


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
    assert length.in_cloud(10.0, metres_of(unit, None)) == pytest.approx(expected, rel=1e-12)


GEOGRAPHIC = 'GEOGCS["WGS 84",DATUM["W",SPHEROID["W",6378137,298.25]],UNIT["degree",0.0174532925199433]]'


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        (f'PROJCS["UTM 32N",{GEOGRAPHIC},PROJECTION["T"],UNIT["metre",1],AXIS["E",EAST]]', 1.0),
        (f'COMPD_CS["both",PROJCS["SPCS",{GEOGRAPHIC},UNIT["foot",0.3048006096]],VERT_CS["h",UNIT["metre",1]]]',
         0.3048006096),
        ('PROJCRS["x",BASEGEOGCRS["W",ELLIPSOID["W",6378137,298,LENGTHUNIT["metre",1]]],CS[Cartesian,2],'
         'AXIS["(E)",east],LENGTHUNIT["foot",0.3048]]', 0.3048),
        (GEOGRAPHIC, None),
        ("", None),
        ('PROJCS["x",UNIT["metre",nonsense]]', None),
        ('PROJCS["x",UNIT["metre",1.2.3]]', None),
    ],
)  # fmt: skip
def test_the_unit_of_a_projected_system(text, metres):
    assert metres_of_wkt(text) == metres


def test_the_coordinate_system_of_a_file_tells_the_unit(two_systems):
    cloud = gppcs.read(two_systems[0])
    with pytest.raises(gppcs.InputError, match="does not say in which unit"):
        gppcs.simplify(cloud, spacing="50cm", method="fps")
    assert (
        gppcs.simplify(cloud, spacing="50cm", unit="m", method="fps").indices
        == gppcs.simplify(cloud, spacing=0.5, method="fps").indices
    ).all()
