"""The polygon cloud as one self-contained HTML file: turn the scene, point at a polygon, read its attributes.

Templates, modules and styles are those of the report (`view/report/page`).
"""

import base64

import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.display_mesh import NO_PATCH, DisplayMesh, display_mesh
from zpm2.cloud.export import attributes
from zpm2.cloud.result import PolygonCloud
from zpm2.view.report.assets import render

MAX_TRIANGLES = 300_000  # about, for the surface and for all patches, each; keeps a page below 30 MB
FIELD_OF_VIEW = 0.7  # radians, from top to bottom
HALF_HEIGHT = 0.45  # half the height that the page shows when it opens, as a share of the extent


def page(cloud: PolygonCloud) -> str:
    """The HTML of a cloud."""
    shown = display_mesh(cloud, MAX_TRIANGLES)
    side = np.cross(shown.up, shown.towards)
    side /= max(float(np.linalg.norm(side)), 1e-12)
    towards = np.cross(side, shown.up)
    data = {
        "about": f"{len(cloud.patches)} polygons from {cloud.matches} matches in {len(cloud.views)} views, "
        f"{100 * cloud.coverage:.0f} % of the surface that they see",
        "distance": HALF_HEIGHT / np.tan(FIELD_OF_VIEW / 2),
        "opening": FIELD_OF_VIEW,
        "frame": [side.tolist(), shown.up.tolist(), towards.tolist()],
        "views": [view.name for view in cloud.views],
        "polygons": [
            attributes(polygon) | {"rgb": rgb.tolist()}
            for polygon, rgb in zip(cloud.patches, cloud.colors, strict=True)
        ],
        "events": [vars(event) for event in cloud.events],
        "parts": [
            _part("surface", shown, shown.ids == NO_PATCH),
            _part("patches", shown, (shown.ids != NO_PATCH) & ~shown.tube),
            _part("tubes", shown, shown.tube),
        ],
    }
    return render("cloud.html", "cloud.js", data, title="Polygon cloud", about=data["about"])


def _part(name: str, shown: DisplayMesh, rows: NDArray[np.bool_]) -> dict[str, str]:
    """The chosen triangles as the page reads them: relative to the centre, in units of the extent.

    Vertices carry a colour and a polygon.
    """
    used, inverse = np.unique(shown.faces[rows], return_inverse=True)
    ids, paint = np.full(len(used), float(NO_PATCH), np.float32), np.zeros((len(used), 3), np.uint8)
    corner = inverse.ravel()
    ids[corner] = np.repeat(shown.ids[rows], 3)
    paint[corner] = np.repeat(shown.colors[rows], 3, axis=0)
    vertices = ((shown.vertices[used] - shown.center) / shown.extent).astype("<f4")
    arrays = {"vertices": vertices, "faces": corner.astype("<u4"), "colors": paint, "ids": ids.astype("<f4")}
    return {"name": name} | {key: base64.b64encode(value.tobytes()).decode() for key, value in arrays.items()}
