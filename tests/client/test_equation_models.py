"""The client's formulas have the fields of the service's."""

import pytest
from pydantic import BaseModel

import armwright_client as ours
from armwright_wire import equations

MODELS = {
    name: model
    for name, model in vars(equations).items()
    if isinstance(model, type) and model.__module__ == equations.__name__
}


@pytest.mark.parametrize("name", MODELS)
def test_fields_are_those_of_the_service(name: str) -> None:
    mine, theirs = getattr(ours, name), MODELS[name]
    assert issubclass(theirs, BaseModel)
    assert list(mine.model_fields) == list(theirs.model_fields)


def test_there_are_formulas() -> None:
    assert len(MODELS) == 8
