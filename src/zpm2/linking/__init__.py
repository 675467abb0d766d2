"""Polygons of two layers without photographs: which is which, by shape and neighbourhood."""

from zpm2.linking.layer import Layer, open_layer
from zpm2.linking.result import Link, LinkResult
from zpm2.linking.run import link
from zpm2.linking.similarity import Similarity, Uncertainty

__all__ = ["Layer", "Link", "LinkResult", "Similarity", "Uncertainty", "link", "open_layer"]
