"""EVENTS: motion, appearance, and reasoning over tracking events."""
