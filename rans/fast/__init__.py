"""The fast engine: thousands of spacecraft stepped together in torch, and the trainer beside them."""
