"""`gppcs methods`."""

import dataclasses
import json

import pytest

import gppcs
from gppcs.methods.parameters import parameters_of


def test_methods_lists_parameters_with_their_defaults(gppcs_command, printed):
    out = printed("methods")
    for name, method in gppcs.METHODS.items():
        assert f"{name}: {method.summary}\n" in out
        assert method.source in out
        for parameter, value in dataclasses.asdict(method()).items():
            assert f"{parameter}={value}" in out
    _, out, _ = gppcs_command("methods", "--json")
    records = [json.loads(line) for line in out.splitlines()]
    assert {record["name"]: record["parameters"] for record in records} == {
        name: dataclasses.asdict(method()) for name, method in gppcs.METHODS.items()
    }


@pytest.mark.parametrize("name", gppcs.METHODS)
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
