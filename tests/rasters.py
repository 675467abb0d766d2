"""Rasters as GDAL writes them. Import after `pytest.importorskip("rasterio")`."""

import rasterio
from rasterio.enums import Resampling


def write(path, values, mask=None, colors=None, palette=None, rpcs=None, overviews=(), **options):
    """(bands, h, w) values as a file."""
    count, height, width = values.shape
    options = {"driver": "GTiff", "width": width, "height": height, "count": count, "dtype": values.dtype, **options}
    with (
        rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True, GDAL_PAM_ENABLED=False),
        rasterio.open(path, "w", **options) as file,
    ):
        if colors:
            file.colorinterp = colors
        if rpcs:
            file.rpcs = rpcs
        if palette:
            file.write_colormap(1, palette)
        file.write(values)
        if mask is not None:
            file.write_mask(mask)
        if overviews:
            file.build_overviews(overviews, Resampling.average)
    return path
