"""The one read layer and the one write layer over MCAP."""
