"""One module per output format; `formats.registry` imports all modules of this folder."""
