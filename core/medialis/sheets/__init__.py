"""Feature sets, point types, medial sheets and the curves where they meet (thesis 6.2)."""
