"""`gppcs methods`."""

import json

import pytest

import gppcs
from gppcs.methods.parameters import parameters_of


@pytest.mark.parametrize("name", gppcs.METHODS.built_in)
def test_methods_explains_one_and_each_of_its_parameters(gppcs_command, printed, name):
    out = printed("methods", name)
    text = " ".join(out.split())
    method = gppcs.METHODS[name]
    assert text.startswith(f"{name}: {method.summary}")
    assert method.source in text
    for key, parameter in parameters_of(method).items():
        assert f"{key} ({parameter.kind}, default {parameter.default}) {parameter.meaning}" in text
    _, out, _ = gppcs_command("methods", name, "--json")
    assert json.loads(out)["meanings"] == {key: parameter.meaning for key, parameter in parameters_of(method).items()}
