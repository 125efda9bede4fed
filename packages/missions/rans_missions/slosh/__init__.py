"""Liquid that sloshes in a tank: its description, the motion of craft and rod, and the same in Drake.

`liquid.py` has `Slosh`, a further effector of a spacecraft (the table ``[slosh]`` of its file); `swinging.py` moves
craft and rod together by the equations of `pendulum.py`; `rods.py` is what Drake makes of it.
"""
