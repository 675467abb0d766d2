"""In and out: photographs read, result files written."""

from zpm2.io.files import atomic_write, claim, output_folder
from zpm2.io.images import read_image

__all__ = ["atomic_write", "claim", "output_folder", "read_image"]
