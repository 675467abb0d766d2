"""The user's disk: safe reading, writing whole files, and the record of what a run made."""
