"""SHELLS: virtual shells, event resolution, pixel membership."""
