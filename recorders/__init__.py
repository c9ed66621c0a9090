"""The world into a log, and the log itself."""
