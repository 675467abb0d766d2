"""Files of regions that users bring along, one module per format; `registry` tells them apart."""
