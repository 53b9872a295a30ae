"""The compact medial mesh: a shape as n balls, connected with the topology of the solid."""
