"""Regions given by the user instead of found by a network; `formats.regions` reads their files."""
