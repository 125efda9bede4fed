"""Who can be judged, and how they fly."""
