"""Bones along curve skeletons, and skin weights."""
