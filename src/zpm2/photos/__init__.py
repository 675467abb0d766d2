"""Photographs read: files of any kind and size, where they lie on the ground, and which pixels hold data."""
