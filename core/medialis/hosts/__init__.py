"""What adapters for host programs need."""
