"""Hostile inputs and faults, made at random from a seed: `make fuzz MINUTES=10`.

Kinds of cases: mutated files for every reader, nasty shapes for every operation, signals and kills
at random moments, damaged caches of kernels, disks that are full, calls of the system that fail
once, and attackers who make names around the output. A case is known by seed, kind
and number; `--case kind:number` runs one again.
"""
