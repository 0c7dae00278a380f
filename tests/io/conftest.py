import pytest


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder for all tests of a module."""
    return tmp_path_factory.mktemp("folder")


@pytest.fixture
def file_of(tmp_path):
    """Write text or bytes to a file of a name, or of a suffix; return its path."""

    def write(name, content):
        path = tmp_path / (f"cloud{name}" if name.startswith(".") else name)
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogateescape"))
        return path

    return write
