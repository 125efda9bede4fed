"""What a policy is: specification, preprocessing, filters, symmetry, networks, heads and memory."""
