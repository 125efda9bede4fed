"""What pushes a craft, over a control period: commands, reaction wheels, propellant, and the motion that follows.

Descriptions lie below, in `rans.model.actuators` and `rans.model.spacecraft`; so do the equations of thrusters
and late valves, which domain randomization needs.
"""
