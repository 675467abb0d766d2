"""Cameras and a surface from photographs: a workspace for the polygon cloud."""

from zpm2.reconstruct.inputs import Inputs, read_inputs
from zpm2.reconstruct.workspace import Reconstruction, claimed_names, reconstruct

__all__ = ["Inputs", "Reconstruction", "claimed_names", "read_inputs", "reconstruct"]
