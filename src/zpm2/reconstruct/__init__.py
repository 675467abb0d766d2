"""A surface and cameras from photographs: a workspace for the polygon cloud, where nobody has made one yet."""

from zpm2.reconstruct.inputs import Inputs, read_inputs
from zpm2.reconstruct.workspace import Options, claimed_names, reconstruct

__all__ = ["Inputs", "Options", "claimed_names", "read_inputs", "reconstruct"]
