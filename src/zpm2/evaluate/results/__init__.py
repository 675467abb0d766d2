"""Area matches that other tools wrote, as they are: one file for each format."""
