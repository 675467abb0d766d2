"""Ways to run one list of pairs: processes of this machine, or Ray."""
