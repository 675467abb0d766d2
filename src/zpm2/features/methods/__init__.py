"""One file for each point matcher, or for a few that share a network. A file is found because it lies here.

Each registers a function with `zpm2.features.registry.point_matcher`. Networks are imported inside that function: all
files are imported to know the names.
"""
