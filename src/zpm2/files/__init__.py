"""The user's disk: reading without surprises, writing whole files, and the record of what a run made."""
