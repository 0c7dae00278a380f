import pytest

from gppcs.engine.extras import require_pyvista
from gppcs.errors import MissingExtraError


@pytest.fixture(scope="session")
def opengl() -> None:
    """Skip tests that draw meshes where that is impossible."""
    try:
        require_pyvista()
    except MissingExtraError as error:
        pytest.skip(str(error))
