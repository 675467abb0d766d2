"""Writes all files of a polygon cloud."""

from pathlib import Path

from zpm2.cloud import export
from zpm2.cloud.display_mesh import display_mesh
from zpm2.cloud.page import page
from zpm2.cloud.picture import three_views
from zpm2.cloud.result import PolygonCloud
from zpm2.errors import Failed
from zpm2.files.writing import atomic_write, claim, replaced_together
from zpm2.photos.pictures import png

NAMES = (
    *("patches.ply", "cloud.glb", "boundaries.geojson", "boundaries.wkt", "points.ply", "points.las"),
    *("cloud.png", "cloud.html", "cloud.json"),
)
SAMPLED_POINTS = 200_000  # about, on all patches together, if no spacing is given


def save(cloud: PolygonCloud, folder: str | Path, spacing: float | None = None, las: bool = False) -> list[str]:
    """Write cloud.json, patches.ply, cloud.glb, boundaries.geojson, boundaries.wkt, points.ply (and points.las),
    cloud.png and cloud.html. Returns what could not be made, and why.

    They take the place of all that an earlier cloud has there (`replaced_together`): where cloud.json exists, the
    folder is complete. `OutputError` if other files have these names. A cloud without polygons writes only cloud.json.
    spacing: distance between the points, in units of the mesh; None for about 200,000 points in all. `ConfigError`
    where it makes more points than memory holds.
    """
    if las:
        export.require_laspy()
    export.check_spacing(cloud, spacing)
    out = claim(folder, NAMES, [view.path for view in cloud.views])
    with replaced_together(out, NAMES) as made:
        if not cloud.patches:
            cloud.save_json(made)
            return ["only cloud.json was written: the cloud has no polygons"]
        missing = []
        export.write_ply(cloud, made / "patches.ply")
        export.write_glb(cloud, made / "cloud.glb")
        export.write_boundaries(cloud, made)
        area = sum(patch.patch.area for patch in cloud.patches)
        between = spacing or max((area / SAMPLED_POINTS) ** 0.5, 1e-12)
        export.write_points(cloud, between, made / "points.ply", *([made / "points.las"] if las else []))
        picture = three_views(display_mesh(cloud))
        if isinstance(picture, Failed):
            missing.append(f"no cloud.png: {picture}")
        else:
            atomic_write(made / "cloud.png", png(picture))
        atomic_write(made / "cloud.html", page(cloud))
        cloud.save_json(made)
        return missing
