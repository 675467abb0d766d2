"""One file for each segmenter, or for a family. A file is found because it lies here.

Each registers a class or function with `zpm2.segment.registry.segmenter`. Networks are imported inside a function: all
files are imported to know the names.
"""
