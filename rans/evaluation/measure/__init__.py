"""What flights are worth, in numbers with intervals."""
