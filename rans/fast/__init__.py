"""Fast engine: thousands of spacecraft stepped together in torch, environments, and trainers on the same device."""
