"""Serves numbered pictures as MPEG-TS to the one who connects, in real time: PORT FIRST FRAMES FPS."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any


def main(port: int, first: int, frames: int, fps: int) -> None:
    """Serves `frames` pictures from number `first` on at `fps`, then ends."""
    import av

    sys.path.insert(0, str(Path(__file__).parents[2]))
    from fixtures.streams import HEIGHT, WIDTH, numbered

    with av.open(f"tcp://127.0.0.1:{port}?listen=1", "w", format="mpegts") as out:
        options = {"bf": "0", "preset": "ultrafast", "tune": "zerolatency"}
        stream: Any = out.add_stream("libx264", rate=fps, options=options)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.gop_size = 5
        began = time.monotonic()
        for number in range(frames):
            frame = av.VideoFrame.from_ndarray(numbered(first + number), format="bgr24")
            out.mux(stream.encode(frame))
            time.sleep(max(0.0, began + (number + 1) / fps - time.monotonic()))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
