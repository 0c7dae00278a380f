"""Optional libraries, which tests take where they can be imported."""

import importlib

import pytest


def import_or_skip(name):
    """Import a library; skip the test where it is missing, or a library of the system that it needs."""
    try:
        return importlib.import_module(name)
    except (ImportError, OSError) as error:
        pytest.skip(f"{name} cannot be imported: {error}")
