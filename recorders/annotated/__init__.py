"""An annotated log: one reader of its frames, what it says of its own making, its digest chain,
its checkpoints and its label images.
"""
