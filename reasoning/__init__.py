"""What targets do to one another: pure, no pixels, no files (`questions` alone reads logs)."""
