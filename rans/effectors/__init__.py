"""Effectors of a craft over a control period, and the motion that follows from them.

`effector.py` is the `Effector` protocol; `propellant.py` and `wheels.py` implement it. `motion.py` has the
thrusters, lists all effectors of a craft and moves it. `commands.py` has the bounds and checks of commands.
Descriptions of effectors are in `rans.model.actuators` and `rans.model.spacecraft`, and the equations of
thrusters in `rans.model.dynamics`; delayed valves are in `rans.randomization.valves`.
"""
