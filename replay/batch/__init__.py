"""Many recordings: each through record, replay and its tables, on this machine or on a cluster.

`sources` finds what there is, `jobs` says what is to be done, `steps` does one, `nursery` keeps
it from doing harm, `engines` spreads them, `driver` goes through all of them.
"""

from replay.batch.driver import BatchOptions, BatchSummary, run_batch
from replay.batch.jobs import Job, Limit, Outcome, Status
from replay.batch.sources import sources_of

__all__ = [
    "BatchOptions",
    "BatchSummary",
    "Job",
    "Limit",
    "Outcome",
    "Status",
    "run_batch",
    "sources_of",
]
