"""Ten shapes with a known answer, and what other packages make of them."""
