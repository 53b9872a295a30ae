"""The site: pages of `docs/` with generated pages beside them, built by Sphinx."""
