"""
Disturbances, faults and assurance
==================================

Measure what an agent tolerates, inject thruster faults, and bound its failure probability.
"""

# %%
# Two agents for the same task: one was trained without randomization, one with that of a laboratory.
import matplotlib.pyplot as plt

import rans

nominal = rans.load_agent("go-to-pose-2d")
robust = rans.load_agent("go-to-pose-2d-robust")

for agent in (nominal, robust):
    for conditions in ("perfect", "lab"):
        solved = agent.under(conditions).evaluate(episodes=128)["solved"]
        interval = f"{solved.low:.1f} to {solved.high:.1f}"
        print(f"{agent.name:>22} under {conditions:>7}: ", end="")
        print(f"{solved.value:5.1f} % ({interval})")

# %%
# Which disturbance is it?
# ------------------------
# A robustness sweep flies each perturbation alone at increasing size, from the same starts. Here valve latency
# only; without ``only`` the sweep has all perturbations, and takes minutes.
report = rans.stress(
    nominal, robust, "lqr", only=["latency"], episodes=64, workers=1, worst=0
)
report

# %%
# The share of solved episodes, against the latency:
figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
found = report.to_json()
levels = [
    one
    for one in found["conditions"].values()
    if one["effect"] in ("latency", "perfect")
]
for name in found["contestants"]:
    points = sorted(
        (one["size"] or 0.0, 100 * one["contestants"][name]["held"]["value"])
        for one in levels
    )
    axes.plot(*zip(*points, strict=True), "o-", label=name)
axes.set(xlabel="latency, s", ylabel="solved, %")
axes.legend()
plt.show()

# %%
# Inject faults
# -------------
# Which thrusters can the platform lose and still push and turn in every direction?
rans.faults("floating-platform")

# %%
# One recoverable thruster fails at a random time of the first 15 s:
one_dead = rans.Conditions(
    faults=rans.FaultConditions(
        count=1, kinds=("dead",), time=(0.0, 15.0), among="recoverable"
    )
)
for name in ("go-to-pose-2d", "go-to-pose-2d-faults"):
    solved = (
        rans.load_agent(name).under(one_dead).evaluate(episodes=128)["solved"]
    )
    print(
        f"{name:>20}: {solved.value:5.1f} % ({solved.low:.1f} to {solved.high:.1f})"
    )

# %%
# Bound the failure probability
# -----------------------------
# Intervals of 128 episodes are wide. ``assure`` flies very many, and gives exact (Clopper-Pearson) bounds.
assurance = rans.assure("go-to-pose-2d", episodes=20_000, worst=0)
campaign = assurance.campaign
most = campaign.bound().high
print(f"{campaign.flights:,} flights, with 99 % confidence:")
print(f"probability of failure at most {most:.1e}")

# %%
# Next
# ----
# ``rans assure RUN --failure-below 1e-4`` flies as many as it takes to show or refute a bound. Bounds hold
# for the simulated conditions: make them at least as bad as reality.
