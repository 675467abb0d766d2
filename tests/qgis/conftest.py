"""The plug-in's folder as a place to import from; its parts without QGIS run in any Python."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "qgis"))
