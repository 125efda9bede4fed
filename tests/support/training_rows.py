"""Rows of progress of a training."""

ROWS = [
    {
        "steps": 1000 * k,
        "seconds": 0.5 * k,
        "success": k / 10,
        "return/position": 2.0 * k,
        "return/attitude": 3.0 * k,
    }
    for k in range(11)
]
