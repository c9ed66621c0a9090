"""A log through the trackers: engine, trackers, annotation, digests, evaluation, command line."""
