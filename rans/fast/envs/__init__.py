"""The engine behind the interfaces of other libraries: Gymnasium and Stable-Baselines3."""
