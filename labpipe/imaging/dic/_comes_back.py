"""Patterns that come back: which of the places that match alike a frame shows, told by all points together.

Bricks, rulers and grids match a period farther as well as a subset can tell, and edges and lines all along themselves.
What does not repeat, grain and tones, tells the places apart in the sum of many subsets, though in none of them; where
it does not, the place is not known.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from labpipe.arrays import Flags, Floats, Floats32, Integers
from labpipe.imaging.dic._edge_profile import along_edges
from labpipe.imaging.dic._motion_uncertainty import one_way
from labpipe.imaging.dic._reference import Reference
from labpipe.imaging.dic._subset_kernel import MOTIONS

#: Points that are asked at most, and at least, to tell whether a pattern comes back and where it is, share of them that
#: a place must leave in the frame, and least half width (px) of what is compared of each.
_MOST, _FEWEST, _SHARE, _LEAST_HALF = 36, 6, 0.4, 15
#: Blur (px) by which edges that are sharper than the pixels match alike at any fraction of a pixel.
_BLUR = 1.5
#: Reach (px) within which a pattern that comes back does so, and within which a lost one is looked for.
_NEAR, _FAR = 40, 110
#: Mean correlation from which a pattern comes back, and by how much it falls on half of the way.
_ALIKE, _FALLS = 0.6, 0.1
#: By how much less than the best other places match at most, so many of them, how far (px) places are apart, and how
#: far the place of one point may be from that of most.
_LESS, _PLACES, _APART, _OWN = 0.2, 48, 3, 1
#: Motion (px) beyond what was expected up to which a place is not looked for again that nothing told.
_HARDLY = 0.5
#: Share that is left at least.
_LEAST = 1e-6
#: Ratio of squared slopes from which it is a line, points of them that are asked at most, and places that are compared
#: with the best one.
_LINES, _MOST_LINES, _RIVALS = 4.0, 16, 8
#: Standard deviations by which all points together tell two places apart, and logarithm of the ratio that they leave.
_TOLD, _CLEARLY = 5.0, 0.7


@dataclass(frozen=True)
class Place:
    """Where the pattern of a frame is: a shift (2,) [px] from where it was looked for, None where no place matches.

    ``rival`` [px] is how far from it the nearest other place is that matches as well; infinite where none does.
    """

    shift: Floats | None
    rival: float


class ComesBack:
    """Tells places of a pattern that comes back."""

    def __init__(self, reference: Reference) -> None:
        self._reference = reference
        self._half = max(_LEAST_HALF, int(reference.subsets.half.max(initial=0)))
        self._before: Floats | None = None
        self._rival = np.inf

    @property
    def asked(self) -> Integers:
        """Points that are asked, none where the pattern does not come back."""
        return self._spread if len(self._copy) else self._spread[:0]

    @cached_property
    def _spread(self) -> Integers:
        """Points whose texture tells a place, spread over the image."""
        return self._chosen(~one_way(self._reference.subsets), _MOST)

    @cached_property
    def lines(self) -> Integers:
        """Points with a texture beside lines, spread over the image, where most hold little more than lines."""
        is_line = one_way(self._reference.subsets, _LINES)
        points = self._chosen(is_line & (2 * is_line.sum() > len(is_line)), _MOST_LINES)
        return points[np.array([self._has_texture(n) for n in points.tolist()], bool)]

    def _has_texture(self, point: int) -> bool:
        """Whether a point holds more than edges and noise."""
        reference = self._reference
        noise, _ = reference.own_noise(point, np.zeros(0))
        noise = min(noise, reference.most_noise[point] / reference.noise.static_frames)
        texture = along_edges(reference, point, noise).texture
        return bool(texture - noise > _TOLD * np.sqrt(2.0 / reference.subsets.level[point, 2]) * texture)

    def _chosen(self, some: Flags, most: int) -> Integers:
        """Return at most so many of some points (point,) that lie within the image, spread over it."""
        subsets = self._reference.subsets
        x, y, half = subsets.x, subsets.y, self._half
        rows, columns = self._reference.mean.shape
        usable = np.flatnonzero(
            some
            & ~self._reference.is_faint
            & (np.minimum(x, columns - 1 - x) >= half)
            & (np.minimum(y, rows - 1 - y) >= half)
        )
        cells = np.stack([x[usable], y[usable]], axis=1) // (2 * half + 1)
        chosen = usable[np.sort(np.unique(cells, axis=0, return_index=True)[1])]
        return chosen[np.unique(np.linspace(0, len(chosen) - 1, most).astype(int))] if len(chosen) else chosen

    @cached_property
    def _copy(self) -> Floats:
        """What each of these points leaves of the copy in the reference that is most alike; empty where none is."""
        none, points = np.zeros(0), self._spread
        if len(points) < _FEWEST:
            return none
        for some in (points[:: len(points) // _FEWEST], points):
            seen = self._scores(some, self._image, np.zeros((len(some), MOTIONS)), _NEAR)
            mean = _mean(*seen[:2])
            copies = [p for p in _tops(mean) if mean[p] > max(_ALIKE, mean[_halfway(p)] + _FALLS)]
            if not copies:
                return none
        left = np.array([self._left(*seen, p) for p in copies])
        return np.asarray(left[int(np.nanmean(left, axis=1).argmin())])

    def look(self, image: Floats32, motion: Floats, moved: Floats, *, is_known: bool) -> Place:
        """Tell where the pattern of a frame is.

        ``image``: (row, column), grey levels of the whole frame; ``motion``: (asked, 6), where the asked
        points are, or are expected; ``moved``: (2,) [px], how far that is from where they were expected;
        ``is_known``: whether they were found there, or are looked for far around.
        """
        image, reach = _blurred(image), _FAR
        if is_known:
            shift, left = self._here(image, motion)
            is_worse = self._before is not None and _clearly(left, self._before)
            if _clearly(self._copy, left) and not is_worse:
                self._before, self._rival = self._kept(left), np.inf
                return Place(shift, np.inf)
            # what nothing told in the last frame is told by nothing in one that hardly moves
            if np.isfinite(self._rival) and np.hypot(*(moved + shift)) <= _HARDLY:
                return Place(shift, self._rival)
            # worse than it was: farther than a period, it may have gone to any other place
            reach = _FAR if is_worse or self._before is None else _NEAR
        place, left = self._find(image, motion, reach, is_known=is_known)
        self._rival = place.rival if is_known else np.inf
        if place.shift is not None and not np.isfinite(place.rival):
            self._before = self._kept(left)
        return place

    def along_lines(self, image: Floats32, motion: Floats) -> Floats | None:
        """Shift (2,) [px] of lines from where they were looked for, None where their texture does not tell one place.

        ``image``: (row, column), grey levels of the whole frame; ``motion``: (line, 6), where they are looked for.
        """
        _, counts, windows = self._scores(self.lines, _blurred(image), motion, _FAR)
        alike = self._explained(self.lines).reshape(len(windows), 2 * self._half + 1, 2 * self._half + 1, -1)
        left = np.stack([_left_everywhere(*each) for each in zip(windows, alike, strict=True)])
        number = counts.sum(axis=0)
        told = -np.where(counts, left, 0.0).sum(axis=0) / np.maximum(number, 1)
        told[number < max(_FEWEST, _SHARE * len(counts))] = -1.0
        tops = sorted(_tops(told), key=lambda p: -told[p])[: _RIVALS + 1]
        by_point = [np.where(counts[:, *p], left[:, *p], np.nan) for p in tops]
        if not tops or not all(_clearly(other, by_point[0]) for other in by_point[1:]):
            return None
        return np.subtract(tops[0], _FAR)[::-1].astype(float)

    def _kept(self, left: Floats) -> Floats:
        """Return what points leave (asked,), or left before where they are not seen."""
        before = np.full(len(left), np.log(_LEAST)) if self._before is None else self._before
        return np.where(np.isfinite(left), left, before)

    def _here(self, image: Floats32, motion: Floats) -> tuple[Floats, Floats]:
        """Shift (2,) [px] to the place that is nearest, and what it leaves (asked,)."""
        reach = _APART + _OWN
        seen = self._scores(self._spread, image, motion, reach)
        own = _nearest(_mean(*seen[:2]))
        return np.subtract(own, reach)[::-1].astype(float), self._left(*seen, own)

    def _find(self, image: Floats32, motion: Floats, reach: int, *, is_known: bool) -> tuple[Place, Floats]:
        """Tell where the pattern is within some reach, and what it leaves there (asked,)."""
        seen = self._scores(self._spread, image, motion, reach)
        mean = _mean(*seen[:2])
        best = mean.max()
        tops = sorted((p for p in _tops(mean) if mean[p] > best - _LESS), key=lambda p: -mean[p])[:_PLACES]
        if is_known:
            own = _nearest(mean)
            tops = [own, *(p for p in tops if np.hypot(p[0] - own[0], p[1] - own[1]) > _APART)]
        if not tops:
            return Place(None, np.inf), np.full(len(motion), np.nan)
        left = np.array([self._left(*seen, p) for p in tops])
        first = 0
        for k in range(1, len(tops)):
            if first == 0 and is_known:
                is_better = _clearly(left[0], left[k]) and _clearly(self._copy, left[k])
            else:
                is_better = _apart(left[first], left[k])[0] > 0.0
            first = k if is_better else first
        # edges sharper than the pixels match best where pixels meet them alike, as copies in the reference do
        is_told = _clearly(self._copy, left[first])
        others = [k for k in range(len(tops)) if k != first and not (is_told and _clearly(left[k], left[first]))]
        away = [float(np.hypot(*np.subtract(tops[k], tops[first]))) for k in others]
        shift = np.subtract(tops[first], reach)[::-1].astype(float)
        return Place(shift, min(away, default=np.inf)), left[first]

    @cached_property
    def _image(self) -> Floats32:
        return _blurred(self._reference.pyramid.image)

    @cached_property
    def _alike(self) -> Floats:
        return self._explained(self._spread)

    def _explained(self, points: Integers) -> Floats:
        """Tell what a shift, gain and offset make of points (asked, pixel, column), orthogonal."""
        image = self._image
        subsets, half = self._reference.subsets, self._half
        down, across = np.gradient(image.astype(float))
        bends = (*np.gradient(down), np.gradient(across)[1])
        alike = []
        for x, y in zip(subsets.x[points].tolist(), subsets.y[points].tolist(), strict=True):
            cut = np.s_[y - half : y + half + 1, x - half : x + half + 1]
            columns = [part[cut].ravel() for part in (np.ones_like(image), image, down, across, *bends)]
            alike.append(np.linalg.qr(np.stack(columns, axis=1).astype(float))[0])
        return np.stack(alike)

    def _scores(
        self, points: Integers, image: Floats32, motion: Floats, reach: int
    ) -> tuple[Floats32, Flags, Floats32]:
        """Correlations (asked, row, column) around each point as it has moved, which count, and what is seen there."""
        import cv2

        subsets, half, size = self._reference.subsets, self._half, 2 * (self._half + reach) + 1
        rows, columns = image.shape
        scores, counts, windows = [], [], []
        steps = np.arange(-reach, reach + 1)
        for n, p in zip(points.tolist(), motion, strict=True):
            x, y = int(subsets.x[n]), int(subsets.y[n])
            area = self._image[y - half : y + half + 1, x - half : x + half + 1]
            turn = np.array([[1.0 + p[1], p[2]], [p[4], 1.0 + p[5]]])
            middle = np.array([x + p[0], y + p[3]])
            matrix = np.column_stack([turn, middle - turn @ np.full(2, half + reach)])
            flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
            seen = cv2.warpAffine(image, matrix, (size, size), flags=flags, borderMode=cv2.BORDER_REPLICATE)
            windows.append(seen)
            scores.append(np.nan_to_num(cv2.matchTemplate(seen, area, cv2.TM_CCOEFF_NORMED), posinf=0.0))
            wide = half * np.abs(turn).sum(axis=1)
            at = middle[:, None, None] + np.multiply.outer(turn[:, 0], steps)[:, None]
            at = at + np.multiply.outer(turn[:, 1], steps)[..., None]
            low, high = wide[:, None, None], np.array([columns - 1, rows - 1])[:, None, None] - wide[:, None, None]
            counts.append(((at >= low) & (at <= high)).all(axis=0))
        inside = np.array(counts)
        return np.where(inside, np.array(scores), 0.0).astype(np.float32), inside, np.array(windows)

    def _left(self, scores: Floats32, counts: Flags, windows: Floats32, place: tuple[int, int]) -> Floats:
        """Logarithm (asked,) of the share that points leave unexplained of what is seen at a place; NaN outside."""
        size = 2 * self._half + 1
        result = np.full(len(windows), np.nan)
        row, column = (max(k - _OWN, 0) for k in place)
        for n in np.flatnonzero(counts[:, place[0], place[1]]).tolist():
            near = scores[n, row : place[0] + _OWN + 1, column : place[1] + _OWN + 1]
            i, j = np.unravel_index(int(near.argmax()), near.shape)
            seen = windows[n, row + i : row + i + size, column + j : column + j + size].ravel().astype(float)
            seen -= seen.mean()
            energy = float(seen @ seen)
            result[n] = (energy - float(np.square(self._alike[n].T @ seen).sum())) / max(energy, 1e-30)
        return np.log(np.maximum(result, _LEAST))


def _left_everywhere(seen: Floats32, alike: Floats) -> Floats:
    """Logarithm (row, column) of the share of what is seen (row, column) that columns (row, column, k) leave there."""
    import cv2

    seen = seen - seen.mean(dtype=np.float64)
    size = alike.shape[0]
    first = size // 2, len(seen) - size // 2
    energy, total = (
        cv2.boxFilter(part, cv2.CV_64F, (size, size), normalize=False)[first[0] : first[1], first[0] : first[1]]
        for part in (seen.astype(float) ** 2, seen.astype(float))
    )
    columns = [np.ascontiguousarray(column, np.float32) for column in np.moveaxis(alike, 2, 0)]
    explained = sum(cv2.matchTemplate(seen.astype(np.float32), c, cv2.TM_CCORR).astype(float) ** 2 for c in columns)
    share = (energy - explained) / np.maximum(energy - total**2 / size**2, 1e-30)
    return np.asarray(np.log(np.maximum(share, _LEAST)))


def _blurred(image: Floats32) -> Floats32:
    import cv2

    return np.asarray(cv2.GaussianBlur(image, (0, 0), _BLUR), np.float32)


def _mean(scores: Floats32, counts: Flags) -> Floats:
    """Mean correlation (row, column) of the points (asked, row, column) that count; -1 where they are few."""
    number = counts.sum(axis=0)
    return np.where(number >= max(_FEWEST, _SHARE * len(counts)), scores.sum(axis=0) / np.maximum(number, 1), -1.0)


def _nearest(mean: Floats) -> tuple[int, int]:
    """Row and column of the best place near the middle."""
    first = len(mean) // 2 - _APART
    near = mean[first : first + 2 * _APART + 1, first : first + 2 * _APART + 1]
    row, column = np.unravel_index(int(near.argmax()), near.shape)
    return int(row) + first, int(column) + first


def _halfway(place: tuple[int, int]) -> tuple[int, int]:
    """Row and column between a place and where a pattern is itself, half of the image away from its border."""
    return (place[0] + _NEAR) // 2, (place[1] + _NEAR) // 2


def _tops(mean: Floats) -> list[tuple[int, int]]:
    """Return rows and columns of the places that match better than those around them."""
    import cv2

    size = 2 * _APART + 1
    highest = cv2.dilate(np.asarray(mean, np.float32), np.ones((size, size), np.uint8))
    rows, columns = np.nonzero((np.asarray(mean, np.float32) >= highest) & (mean > -1.0))
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def _clearly(more: Floats, less: Floats) -> bool:
    """Tell whether points (asked,) leave clearly more at one place than at another."""
    deviations, mean = _apart(more, less)
    return deviations > _TOLD and mean > _CLEARLY


def _apart(one: Floats, other: Floats) -> tuple[float, float]:
    """Tell what points (asked,) leave more at one place than at another, in standard deviations, and on average."""
    more = (one - other)[np.isfinite(one - other)]
    if len(more) >= _FEWEST:
        mean, variance = more.mean(), more.var(ddof=1) / len(more)
    else:
        parts = one[np.isfinite(one)], other[np.isfinite(other)]
        if min(len(part) for part in parts) < _FEWEST:
            return 0.0, 0.0
        mean = parts[0].mean() - parts[1].mean()
        variance = sum(part.var(ddof=1) / len(part) for part in parts)
    return float(mean / max(np.sqrt(variance), 1e-12)), float(mean)
