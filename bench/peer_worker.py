"""A renderer in a process of its own, which is asked for pictures one after the other.

A worker is started with the file of a task: JSON, its arrays in .npz and .ply files beside it. It
makes its scene once, says that it is ready, and then answers each line {"seed", "spp", "out"} with
{"seconds"}, the time of rendering alone, after it has saved the picture, (H, W, 3) float32 of
linear radiance, row 0 on top. Nothing here needs furcl: other renderers bring their own packages.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

Task = Mapping[str, Any]
#: Renders with seed and samples a pixel: a picture, or that and its seconds, where not all of the
#: time is that of rendering.
Render = Callable[[int, int], Any]


def serve(prepare: Callable[[Task, Path], tuple[Render, dict[str, Any]]]) -> None:
    """Answer on what was standard output; renderers write where they like.

    Parameters
    ----------
    prepare : callable      of the task and its folder; returns what renders, and facts of it
    """
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    path = Path(sys.argv[1])
    render, facts = prepare(json.loads(path.read_text(encoding="utf-8")), path.parent)
    print(json.dumps({"ready": True, **facts}), file=answers, flush=True)
    for line in sys.stdin:
        wanted = json.loads(line)
        start = time.perf_counter()
        found = render(wanted["seed"], wanted["spp"])
        picture, seconds = found if isinstance(found, tuple) else (found, None)
        picture = np.asarray(picture, np.float32)
        seconds = seconds or time.perf_counter() - start
        np.save(wanted["out"], picture[:, :, :3])
        print(json.dumps({"seconds": seconds}), file=answers, flush=True)
