"""Files in and out."""

from zpm2.files.writing import atomic_write, claim, output_folder
from zpm2.photos.images import read_image

__all__ = ["atomic_write", "claim", "output_folder", "read_image"]
