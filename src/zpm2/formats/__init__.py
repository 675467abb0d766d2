"""Reading and writing files: results, polygons, cameras, meshes, depth maps."""

from zpm2.files.writing import atomic_write, claim, output_folder
from zpm2.photos.images import read_image

__all__ = ["atomic_write", "claim", "output_folder", "read_image"]
