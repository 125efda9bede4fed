"""How fast the engine, the trainer, the optimiser and an agent are, beside what the machine allows."""
