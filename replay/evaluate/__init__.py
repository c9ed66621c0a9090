"""How good a result is against a labelled truth: HOTA, CLEAR, Identity, and the trajectory
criteria of PARTS.

>>> truth = MotTable.from_rows([(f, 1, 10.0 + f, 20.0, 30.0, 60.0, 1.0) for f in range(5)])
>>> scores = evaluate(truth, truth)
>>> scores.hota.hota, scores.clear.mota, scores.identity.idf1
(100.0, 100.0, 100.0)
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from replay.evaluate.clear import Clear, clear, match
from replay.evaluate.hota import Hota, hota
from replay.evaluate.identity import Identity, identity
from replay.evaluate.overlap import overlap
from replay.evaluate.trajectories import Errors, Trajectories, Trajectory, trajectories
from replay.evaluate.truth import MotTable, fit_truth, read_caviar, read_mot, read_truth

__all__ = [
    "Clear",
    "Errors",
    "Hota",
    "Identity",
    "MotTable",
    "Scores",
    "Trajectories",
    "Trajectory",
    "evaluate",
    "fit_truth",
    "read_caviar",
    "read_mot",
    "read_truth",
]


@dataclass(frozen=True)
class Scores:
    """Everything about one result against one truth. Shares are in percent."""

    hota: Hota
    clear: Clear
    identity: Identity
    trajectories: Trajectories
    true_boxes: int
    result_boxes: int
    true_ids: int
    result_ids: int

    def __str__(self) -> str:
        clear = self.clear
        return (
            f"HOTA {self.hota.hota:.1f}  MOTA {clear.mota:.1f}  IDF1 {self.identity.idf1:.1f} "
            f" switches {clear.switches}  fragments {clear.fragments}  MT {clear.mostly_tracked}  ML"
            f" {clear.mostly_lost}  P {clear.precision:.1f}  R {clear.recall:.1f}  DetA"
            f" {self.hota.det_a:.1f}  AssA {self.hota.ass_a:.1f}"
        )

    def as_plain(self) -> dict[str, Any]:
        """Plain data for JSON: the usual names on top, the details below them."""
        h, c, i = self.hota, self.clear, self.identity
        return {
            "HOTA": h.hota, "DetA": h.det_a, "AssA": h.ass_a, "LocA": h.loc_a,
            "DetRe": h.det_re, "DetPr": h.det_pr, "AssRe": h.ass_re, "AssPr": h.ass_pr,
            "MOTA": c.mota, "MOTP": c.motp, "precision": c.precision, "recall": c.recall,
            "TP": c.true_positives, "FP": c.false_positives, "FN": c.false_negatives,
            "switches": c.switches, "fragments": c.fragments,
            "mostly_tracked": c.mostly_tracked, "partly_tracked": c.partly_tracked, "mostly_lost": c.mostly_lost,
            "IDF1": i.idf1, "IDP": i.idp, "IDR": i.idr, "IDTP": i.idtp, "IDFP": i.idfp, "IDFN": i.idfn,
            "true_boxes": self.true_boxes, "result_boxes": self.result_boxes,
            "true_ids": self.true_ids, "result_ids": self.result_ids,
            "alphas": list(h.alphas),
            "HOTA_alpha": list(h.hota_alpha), "DetA_alpha": list(h.det_a_alpha),
            "AssA_alpha": list(h.ass_a_alpha), "LocA_alpha": list(h.loc_a_alpha),
            "trajectories": asdict(self.trajectories),
        }  # fmt: skip


def evaluate(truth: MotTable, result: MotTable, iou: float = 0.5) -> Scores:
    """Score a result against a truth, figures as TrackEval's (HOTA, CLEAR, Identity) plus PARTS
    5.2 and 5.3.

    Args:
        truth: only what counts (`read_truth` drops the rows of confidence 0), in the same pixels
            as the result.
        result: what a tracker said.
        iou: overlap from which on two boxes match, in CLEAR and Identity.
    """
    both = overlap(truth, result)
    matches = match(both, iou)
    given = identity(both, iou)
    n, m = both.shape
    return Scores(
        hota(both),
        clear=clear(both, matches),
        identity=given,
        trajectories=trajectories(both, matches, given, iou),
        true_boxes=len(truth),
        result_boxes=len(result),
        true_ids=n,
        result_ids=m,
    )
