"""The trackers, one folder per paper, none imports another."""
