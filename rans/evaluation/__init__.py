"""What a flight is worth: metrics, figures and reports."""
