"""What `benchmarks/shown_numbers.py` is made of: shapes of known size, and what tells numbers."""
