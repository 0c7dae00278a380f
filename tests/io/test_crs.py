"""The units that coordinate systems name."""

import math

import pytest

from gppcs.io.crs import units_of_keys, units_of_wkt
from gppcs.spatial.units import Units

GEOGRAPHIC = 'GEOGCS["WGS 84",DATUM["W",SPHEROID["W",6378137,298.25]],UNIT["degree",0.0174532925199433]]'
UTM = f'PROJCS["UTM 32N",{GEOGRAPHIC},PROJECTION["T"],UNIT["metre",1],AXIS["E",EAST]]'
FOOT_US = 0.304800609601219
ON_LATITUDES = ('GEOGCRS["W",DATUM["W",ELLIPSOID["W",6378137,298,LENGTHUNIT["metre",1]]],CS[ellipsoidal,3],'
                'AXIS["(lat)",north,ANGLEUNIT["grad",0.0157]],AXIS["(lon)",east,ANGLEUNIT["grad",0.0157]],'
                'AXIS["(h)",up,LENGTHUNIT["foot",0.3048]]]')  # fmt: skip


@pytest.mark.parametrize(
    ("text", "units"),
    [
        (UTM, (1, 1)),
        (f'COMPD_CS["both",PROJCS["SPCS",{GEOGRAPHIC},UNIT["foot",0.3048]],VERT_CS["h",UNIT["metre",1]]]', (0.3048, 1)),
        (f'{UTM},VERTCS["N",VDATUM["d"],PARAMETER["Direction",1.0],UNIT["Foot_US",{FOOT_US}]]', (1, FOOT_US)),
        (f'COMPD_CS["both",{GEOGRAPHIC},VERT_CS["h",UNIT["foot",0.3048]]]', (0.0174532925199433, 0.3048, True)),
        ('PROJCRS["x",BASEGEOGCRS["W",ELLIPSOID["W",6378137,298,LENGTHUNIT["metre",1]]],CS[Cartesian,2],'
         'AXIS["(E)",east],LENGTHUNIT["foot",0.3048]]', (0.3048, 0.3048)),
        ('COMPOUNDCRS["x",BOUNDCRS[SOURCECRS[PROJCRS["x",CS[Cartesian,2],AXIS["E",east,LENGTHUNIT["metre",1]]]]],'
         f'VERTCRS["v",CS[vertical,1],AXIS["h",up],LENGTHUNIT["foot",{FOOT_US}]]]', (1, FOOT_US)),
        ('GEODCRS["x",CS[Cartesian,3],AXIS["X",geocentricX],LENGTHUNIT["metre",1]]', (1, 1)),
        (ON_LATITUDES, (0.0157, 0.3048, True)),
        (GEOGRAPHIC, (0.0174532925199433, 1, True)),
        ("", None),
        ('PROJCS["x",UNIT["metre",nonsense]]', None),
        ('PROJCS["x",UNIT["metre",1.2.3]]', None),
        ('PROJCS["x",UNIT["metre",1]', None),
        ("COMPD_CS[" * 10_000 + "]" * 10_000, None),
    ],
)  # fmt: skip
def test_well_known_text_names_the_unit_of_each_axis(text, units):
    assert units_of_wkt(text) == (units and Units(*units))


@pytest.mark.parametrize(
    ("keys", "units"),
    [
        ({1024: 1, 3072: 2991, 3076: 9002}, (0.3048, 0.3048)),
        ({1024: 1, 3072: 26910, 3076: 9001, 4099: 9003}, (1, 1200 / 3937)),
        ({3072: 26910, 3076: 9001, 4096: 6360}, (1, 1200 / 3937)),
        ({1024: 2, 2048: 4326}, (math.pi / 180, 1, True)),
        ({2048: 4326, 2054: 9105, 4099: 9002}, (math.pi / 200, 0.3048, True)),
        ({1024: 1, 3072: 32632, 4099: 9001}, None),
    ],
)
def test_keys_of_geotiff_name_the_unit_of_each_axis(keys, units):
    assert units_of_keys(keys) == (units and Units(*units))
