"""Labels of a plot that hide nothing, neither each other nor what is drawn, and stand next to what they name."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from froxel_ref.arrays import Field
from froxel_ref.report_sheet import Sheet

__all__ = ["along", "draw_label", "extents", "label_boxes"]


def label_boxes(anchors: Field, sizes: Field, things: Field, weights: Field, area: tuple[float, float, float, float]
            ) -> tuple[Field, bool]:
    """Boxes for labels near their anchors, apart from each other, from things, and within the area.

    Parameters
    ----------
    anchors, sizes : ndarray, shape (n, 2)
    things : ndarray, shape (m, 4)
        Boxes that labels should not hide, and how much it matters: ``weights``, shape (m,).
    area : tuple of float
        x0, y0, x1, y1, as all boxes.

    Returns
    -------
    boxes : ndarray, shape (n, 4)
    apart : bool
        Whether no two of them overlap, and all are within the area.

    Examples
    --------
    >>> boxes, apart = label_boxes(np.array([[50.0, 50.0], [52.0, 50.0]]), np.array([[30.0, 12.0], [30.0, 12.0]]),
    ...                            np.zeros((0, 4)), np.zeros(0), (0.0, 0.0, 100.0, 100.0))
    >>> boxes.shape, apart
    ((2, 4), True)
    """
    boxes, far = _around(anchors, sizes)
    cost = far[:, None] + np.einsum("cnm,m->cn", _overlap(boxes[:, :, None, :], things), weights)
    outside = (np.maximum(area[0] - boxes[..., 0], 0.0) + np.maximum(area[1] - boxes[..., 1], 0.0)
               + np.maximum(boxes[..., 2] - area[2], 0.0) + np.maximum(boxes[..., 3] - area[3], 0.0))
    wrong = _inside(anchors, (boxes + np.array([-8.0, -5.0, 8.0, 5.0]))[:, :, None, :])  # would seem to be another's
    wrong[:, np.arange(len(anchors)), np.arange(len(anchors))] = False
    cost = cost + 1e3 * outside + 45.0 * wrong.sum(axis=2)
    every = np.arange(len(anchors))
    best = np.argsort(cost, axis=0, kind="stable")[:80]  # the rest is far away
    cost, boxes, outside = (np.take_along_axis(values, best.reshape(best.shape + (1,) * (values.ndim - 2)), axis=0)
                            for values in (cost, boxes, outside))
    best = _chosen(cost, _between(anchors, boxes))
    placed = boxes[best, every]
    clash = _overlap(placed[:, None], placed[None])
    np.fill_diagonal(clash, 0.0)
    return placed, not bool(clash.any()) and not bool((outside[best, every] > 0.5).any())


def _around(anchors: Field, sizes: Field) -> tuple[Field, Field]:
    """Boxes about each anchor, shape (places, n, 4), and what it costs to be that far away, shape (places,)."""
    turns = np.arange(16) * (math.pi / 8.0) - math.pi / 4.0  # up and to the right first
    reach = np.array([7.0, 13.0, 20.0, 30.0, 42.0, 58.0, 78.0, 102.0, 130.0])
    way = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    # A box touches the circle of that radius about its anchor: across by the side that it lies on.
    offsets = (reach[:, None, None] * way).reshape(-1, 1, 2)
    sides = np.tile(np.clip(way * 1.42, -1.0, 1.0), (len(reach), 1))[:, None, :]
    centres = anchors + offsets + sides * sizes / 2.0
    boxes = np.concatenate([centres - sizes / 2.0, centres + sizes / 2.0], axis=-1)
    far = np.repeat(reach, len(turns)) ** 1.5 * 0.35 + np.tile(0.8 * np.abs(np.sin((turns + math.pi / 4) / 2)),
                                                               len(reach))
    return boxes, far


def _overlap(a: Field, b: Field) -> Field:
    """Areas that boxes (…, 4) of x0, y0, x1, y1 have in common, broadcast."""
    wide = np.minimum(a[..., 2], b[..., 2]) - np.maximum(a[..., 0], b[..., 0])
    high = np.minimum(a[..., 3], b[..., 3]) - np.maximum(a[..., 1], b[..., 1])
    return np.asarray(np.maximum(wide, 0.0) * np.maximum(high, 0.0))


def _between(anchors: Field, boxes: Field) -> list[dict[int, Field]]:
    """For each label by each other one near it: what any two of their places (rows and columns) cost together."""
    near = np.clip(anchors, boxes[..., :2], boxes[..., 2:])
    leaders = anchors[:, None, :] + np.linspace(0.25, 1.0, 4)[:, None] * (near - anchors)[:, :, None, :]
    hulls = np.concatenate([boxes[..., :2].min(axis=0), boxes[..., 2:].max(axis=0)], axis=1)
    pairs: list[dict[int, Field]] = [{} for _ in anchors]
    for i, j in zip(*np.nonzero(np.triu(_overlap(hulls[:, None], hulls[None]) > 0.0, 1)), strict=True):
        clash = _overlap(boxes[:, i, None], (boxes[:, j] + np.array([-2.0, -1.0, 2.0, 1.0]))[None])
        crossed = _inside(leaders[:, i, None], boxes[None, :, j, None]).sum(axis=2)
        crossed += _inside(leaders[None, :, j], boxes[:, i, None, None]).sum(axis=2)
        pairs[i][int(j)] = clash + 200.0 * (clash > 0.0) + 12.0 * crossed
        pairs[j][int(i)] = pairs[i][int(j)].T
    return pairs


def _chosen(cost: Field, pairs: Sequence[Mapping[int, Field]]) -> NDArray[np.intp]:
    """A place for each label, such that no label alone, and hardly any with those that it pushes away, is better off.

    Parameters
    ----------
    cost : ndarray, shape (places, labels)
        Of each place, whatever the others do.
    pairs : sequence of mapping of int to ndarray, shape (places, places)
        What two labels cost together.
    """
    every = np.arange(cost.shape[1])

    def costs(i: int, chosen: NDArray[np.intp]) -> Field:
        total = cost[:, i].copy()
        for j, both in pairs[i].items():
            total += both[:, chosen[j]]
        return total

    def settled(chosen: NDArray[np.intp], order: NDArray[np.intp], most: int) -> tuple[NDArray[np.intp], float]:
        """Each in turn takes its best place, until none moves; and what all cost then."""
        for _ in range(most):
            before = chosen.copy()
            for i in map(int, order):
                chosen[i] = np.argmin(costs(i, chosen))
            if np.array_equal(before, chosen):
                break
        alone = cost[chosen, every]
        together = sum(costs(int(i), chosen)[chosen[i]] - alone[i] for i in every)
        return chosen, float(alone.sum() + 0.5 * together)

    start = np.argmin(cost, axis=0)
    best, least = min((settled(start.copy(), order, 30) for order in (every, every[::-1])), key=lambda found: found[1])
    for i in np.argsort(cost.min(axis=0) - cost[best, every], kind="stable")[:24]:  # pushed away, they push back
        for wish in np.argsort(cost[:, i], kind="stable")[:3]:
            if cost[best[i], i] > cost[wish, i] + 4.0:
                trial = best.copy()
                trial[i] = wish
                trial, total = settled(trial, np.append(every[every != i], i), 3)
                if total < least - 1e-9:
                    best, least = trial, total
    return best


def _inside(points: Field, boxes: Field) -> NDArray[np.bool_]:
    """Whether points (…, 2) lie in boxes (…, 4), broadcast."""
    x, y = points[..., 0], points[..., 1]
    return np.asarray((x >= boxes[..., 0]) & (x <= boxes[..., 2]) & (y >= boxes[..., 1]) & (y <= boxes[..., 3]))


def along(xs: Sequence[float], ys: Sequence[float]) -> Field:
    """Small boxes along a line of upright and level pieces, as things that labels should not hide.

    Parameters
    ----------
    xs, ys : sequence of float [px]
        Its corners.

    Returns
    -------
    ndarray, shape (m, 4)

    Examples
    --------
    >>> along([0.0, 8.0], [5.0, 5.0]).tolist()
    [[-3.0, 2.0, 3.0, 8.0], [5.0, 2.0, 11.0, 8.0]]
    """
    parts = []
    for x0, x1, y0, y1 in zip(xs[:-1], xs[1:], ys[:-1], ys[1:], strict=True):
        steps = max(2, int(max(abs(x1 - x0), abs(y1 - y0)) / 8.0) + 1)
        parts.append(np.stack([np.linspace(x0, x1, steps), np.linspace(y0, y1, steps)], axis=1))
    middle = np.concatenate(parts) if parts else np.zeros((0, 2))
    return np.concatenate([middle - 3.0, middle + 3.0], axis=1)


def extents(sheet: Sheet, words: Sequence[str]) -> Field:
    """The room that labels take.

    Parameters
    ----------
    sheet : Sheet
    words : sequence of str

    Returns
    -------
    ndarray, shape (n, 2) [px]
    """
    return np.array([(sheet.long(word, True) + 3.0, 1.16 * sheet.size) for word in words])


def draw_label(sheet: Sheet, words: str, box: Field, anchor: Sequence[float] | Field, colour: str,
               gid: str | None = None, *, bold: bool = False) -> None:
    """Words in their box, and a line to their anchor where it is not next to them.

    Parameters
    ----------
    sheet : Sheet
    words : str
    box : ndarray, shape (4,)
        Of `label_boxes`.
    anchor : x, y [px]
    colour, gid, bold
        As for `froxel_ref.report_sheet.Sheet.text`.
    """
    x, y = min(max(anchor[0], box[0]), box[2]), min(max(anchor[1], box[1]), box[3])
    if math.hypot(x - anchor[0], y - anchor[1]) > 15.0:
        gap = 7.0 / math.hypot(x - anchor[0], y - anchor[1])
        sheet.line([anchor[0] + gap * (x - anchor[0]), x], [anchor[1] + gap * (y - anchor[1]), y], "edge", 0.8,
                   order=2.6)
    if colour != "fail":
        sheet.box(box[0] + 1.0, box[1] + 1.0, box[2] - 1.0, box[3] - 1.0, "paper", alpha=0.72, order=2.7)
    sheet.text((box[0] + box[2]) / 2.0, (box[1] + box[3]) / 2.0, words, colour, "center", bold=bold, gid=gid)
