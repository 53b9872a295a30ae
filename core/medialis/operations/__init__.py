"""The registry: every operation declared once, from which all hosts build their doors.

Adding an algorithm is one module in the core and one `Operation` in this folder.
"""
