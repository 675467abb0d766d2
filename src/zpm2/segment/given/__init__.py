"""Regions given by the user: label images, COCO JSON, GeoJSON, shapefiles."""
