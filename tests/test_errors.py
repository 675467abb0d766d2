import pytest

from zpm2 import errors
from zpm2.errors import Failed, Zpm2Error


def test_failed_is_falsy_and_says_why():
    failure = Failed("only 3 points")
    assert not failure
    assert str(failure) == failure.reason == "only 3 points"
    assert failure == Failed("only 3 points") != Failed("no points")


@pytest.mark.parametrize(
    "name", ["InputError", "ConfigError", "WeightsError", "OutputError", "ForkError", "MissingDependency"]
)
def test_one_base_catches_every_named_error(name):
    kind = getattr(errors, name)
    with pytest.raises(Zpm2Error, match="do this"):
        raise kind("do this")


def test_the_base_does_not_catch_what_is_a_bug():
    assert not issubclass(Zpm2Error, ValueError | OSError | RuntimeError)
