"""Parts as engineers have them, with fillets, whose walls, welds and ribs are known.

`kinds.py` makes each kind of part (needs cadquery), `profiles.py` its outlines, `make.py` the
files; `truth.py` says what is known of a part, and `measure.py` what operations get wrong of it.
"""
