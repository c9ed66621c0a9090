"""Quick look at a tracker's text: ``python -m replay.evaluate gt.txt result.txt --scale 0.625``."""

from __future__ import annotations

import argparse
import sys

from recorders.errors import SceneTraceError
from replay.evaluate import evaluate, read_mot, read_truth


def main() -> int:
    """Print one line of scores; exit code 1 on an error."""
    parser = argparse.ArgumentParser(prog="python -m replay.evaluate", description=__doc__)
    parser.add_argument("truth", help="MOTChallenge text or CAVIAR XML")
    parser.add_argument("result", help="MOTChallenge text")
    parser.add_argument(
        "--scale",
        type=float,
        default=1.0,
        help="the result's pixels over the truth's (default 1)",
    )
    parser.add_argument(
        "--iou", type=float, default=0.5, help="overlap of a match (default 0.5)"
    )
    args = parser.parse_args()
    try:
        truth = read_truth(args.truth).scaled(args.scale, args.scale)
        sys.stdout.write(f"{evaluate(truth, read_mot(args.result), args.iou)}\n")
    except SceneTraceError as error:
        sys.stderr.write(f"scenetrace: error: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
