"""Regions of one photograph in another (`zpm2.carry`)."""

from dataclasses import dataclass

from zpm2.config.fields import number, share

CARRY = "measured, docs/carry.md"


@dataclass(frozen=True)
class CarryConfig:
    """`zpm2 carry`."""

    neighbors: int = number(10, "cells of the left photograph that label a cell of the right one", low=1, high=1000, source=CARRY)
    temperature: float = number(0.1, "of the neighbours' weights", unit="cosine", above=True, high=100.0, source=CARRY)
