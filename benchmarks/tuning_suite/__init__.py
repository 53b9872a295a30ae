"""How far results move when the numbers that tune algorithms are halved and doubled.

`numbers.py` finds the numbers in the sources, who reads them, and writes what was measured beside
them; `shapes.py` has two dozens of small shapes; `runs.py` runs operations with other numbers and
keeps what these cannot change. `../tuning.py` is the command.
"""
