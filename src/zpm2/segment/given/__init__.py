"""Regions that the user brings: label images, COCO JSON, GeoJSON, shapefiles."""
