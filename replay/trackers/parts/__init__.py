"""PARTS: part-based model and layered data association."""
