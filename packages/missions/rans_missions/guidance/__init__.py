"""Guidance: laws that say which change of velocity or thrust brings a craft to its goal.

Each law is a pure function of state, goal and limits over fields (`rans.model.fields`), so that one source serves
NumPy, torch, CasADi and the printed kernels. Laws know no task: a task says what is asked and may name the guidance
that its policies observe, its rewards measure and its controllers fly.
"""
