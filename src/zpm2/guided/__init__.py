"""Guided re-detection: regions of one photograph are warped into the other and become prompts there."""
