"""What pushes a craft, over a control period: one `Effector` after the other, and the motion that follows.

`effector.py` is the protocol; `propellant.py` and `wheels.py` implement it; `motion.py` has the
thrusters, lists all effectors of a craft and moves it; `commands.py` is what commands of a craft may be.
Descriptions lie below, in `rans.model.actuators` and `rans.model.spacecraft`; so do the equations of thrusters
and late valves, which domain randomization needs.
"""
