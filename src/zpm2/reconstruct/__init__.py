"""Cameras and a surface from photographs: a workspace for the polygon cloud."""

from zpm2.reconstruct.workspace import Reconstruction, claimed_names, reconstruct

__all__ = ["Reconstruction", "claimed_names", "reconstruct"]
