"""Flights and spacecraft in three dimensions: bodies, cameras, pictures, videos and the Meshcat view."""
