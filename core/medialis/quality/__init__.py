"""How good a result is: reconstruction error, emptiness, topology, and the report of a run."""
