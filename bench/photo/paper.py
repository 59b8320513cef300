"""The paper's route on a rendered photo: rectified view, threshold, whole pixels."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from bench.render.truth import Truth
from camgen.model.job import Job
from camgen.model.pose import pose_from_values
from camgen.plan.image_space import image_space
from camgen.read.files import Files
from camgen.read.job_file import load_job
from camgen.vision.boards.find import find
from camgen.vision.boards.sheet import make_sheet
from camgen.vision.camera.camera import Camera, read_camera
from camgen.vision.image import Picture, read_picture
from camgen.vision.plane import Plane, fit_plane, make_plane
from camgen.vision.to_scale import rectify

#: mm around the tool's path that the view shows.
ROOM = 4.0


def paper_route(folder: Path, name: str, photo: str, truth: Truth) -> np.ndarray:
    """Points (N,) of the paths of the integer-pixel route, mm, 0.1 mm apart at most.

    The mask is the largest piece of Otsu's threshold around the part, which is as good as the
    paper's background model.
    """
    job = load_job(folder / f"{name}.toml")
    picture = read_picture(Files().read(folder / photo))
    camera = read_camera(Files().read(folder / f"{name}.yaml"))
    plane = _plane(job, picture, camera)
    x, y = truth.points.real, truth.points.imag
    region = (x.min() - ROOM, y.min() - ROOM, x.max() + ROOM, y.max() + ROOM)
    view = rectify(picture, camera, plane, region)
    grey = view.pixels if view.pixels.ndim == 2 else cv2.cvtColor(view.pixels, cv2.COLOR_BGR2GRAY)
    _, mask = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    # The rim of the view is bench.
    rim = np.concatenate([mask[2], mask[-3], mask[:, 2], mask[:, -3]])
    mask = cv2.bitwise_not(mask) if np.median(rim) else mask
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    assert count > 1, "no part in the mask"
    part = np.where(labels == 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA]), 255, 0).astype(np.uint8)
    paths, _ = image_space(part, view.work_from_view, job, exact=False)
    return np.concatenate([_sample(path.position[:, :2] @ [1, 1j]) for path in paths])


def _plane(job: Job, picture: Picture, camera: Camera) -> Plane:
    table = job.camera
    if table.markers:
        return find(picture, camera, make_sheet(table.markers), height=table.height)
    if table.plane_from:
        return make_plane(camera, pose_from_values(table.plane_from))
    return fit_plane(camera, table.points_px, table.points_mm)


def _sample(corners: np.ndarray) -> np.ndarray:
    lines = []
    for start, end in pairwise(corners):
        lines.append(np.linspace(start, end, math.ceil(abs(end - start) / 0.1) + 1))
    return np.concatenate(lines)
