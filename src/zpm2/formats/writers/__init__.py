"""One module per output format, found by its place here (`formats.registry`)."""
