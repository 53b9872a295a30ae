"""How well a result describes its shape: exact distances, topology, verdicts, the report."""
