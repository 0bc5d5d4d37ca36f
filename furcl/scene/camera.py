"""The camera table of a scene: placed by hand or framed, perspective or orthographic."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from furcl.groom.motion import times_within
from furcl.scene.motion import check_key_times
from furcl.table import Coordinate, Length, Table, Vec3

DEFAULT_AZIMUTH_DEG = 0.0
DEFAULT_ELEVATION_DEG = 10.0
DEFAULT_MARGIN = 0.05
DEFAULT_VFOV_DEG = 30.0
POINTS_AT_ONCE = 1 << 17


class CameraKey(Table, frozen=True, kw_only=True):
    """Where a camera is at a time.

    Of a list, `[[camera.keys]]`, in the order of time. Between two keys origin, target and up go
    straight: a camera that turns far wants a key every few degrees.

    Attributes
    ----------
    time : float            in the unit of shutter
    origin : (x, y, z)      where it is; the camera's own if left out [unit]
    target : (x, y, z)      what it looks at; the camera's own if left out [unit]
    up : (x, y, z)          any vector not along the view; the camera's own if left out
    """

    time: Coordinate
    origin: Vec3 | None = None
    target: Vec3 | None = None
    up: Vec3 | None = None


class Camera(Table, frozen=True, kw_only=True):
    """Where the picture is taken from.

    With `origin` and `target` it looks from one to the other. Without, it is placed so that a groom
    fills the picture, on the side that `azimuth_deg` and `elevation_deg` name. An orthographic one
    sees along parallel rays, from the plane through `origin` on.

    Attributes
    ----------
    origin : (x, y, z)            where it is; with target, or neither of them [unit]
    target : (x, y, z)            what it looks at [unit]
    up : (x, y, z)                any vector not along the view
    vfov_deg : float              full vertical angle of view, of perspective [deg]
    projection : str              "perspective", or "orthographic": parallel rays
    height : float                of what is seen, of orthographic; left out it frames, which needs
                                  neither origin nor target [unit]
    aperture_radius : float       of the lens; 0 is a pinhole [unit]
    focus_distance : float        along the view axis; the target's if left out [unit]
    azimuth_deg : float           of the camera seen from the groom, from +x towards +y; 0 if left
                                  out [deg]
    elevation_deg : float         of the camera over the horizon; 10 if left out [deg]
    margin : float                part of the half picture that stays free; 0.05 if left out
    shutter : 2 numbers           when it opens and closes; what moves is blurred in between, every
                                  time counting alike. Equal: no time passes
    keys : list of tables         how it moves: places at times
    """

    origin: Vec3 | None = None
    target: Vec3 | None = None
    up: Vec3 = (0.0, 0.0, 1.0)
    vfov_deg: Annotated[float, Meta(ge=0.1, le=170.0)] = DEFAULT_VFOV_DEG
    projection: Literal["perspective", "orthographic"] = "perspective"
    height: Length | None = None
    aperture_radius: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    focus_distance: Annotated[float, Meta(gt=0.0, le=1e9)] | None = None
    azimuth_deg: Annotated[float, Meta(ge=-360.0, le=360.0)] | None = None
    elevation_deg: Annotated[float, Meta(ge=-89.0, le=89.0)] | None = None
    margin: Annotated[float, Meta(ge=0.0, le=0.9)] | None = None
    shutter: tuple[Coordinate, Coordinate] = (0.0, 0.0)
    keys: tuple[CameraKey, ...] = ()

    def __post_init__(self) -> None:
        if self.shutter[0] > self.shutter[1]:
            raise ValueError(
                f"shutter = {list(self.shutter)} closes before it opens; exchange the two times"
            )
        if self.keys:
            self._check_keys()
        if not self.keys and (self.origin is None) != (self.target is None):
            given, missing = ("origin", "target") if self.target is None else ("target", "origin")
            raise ValueError(
                f"{given} is given without {missing}; give both, or neither for automatic framing"
            )
        self._check_projection()
        framing = [
            k for k in ("azimuth_deg", "elevation_deg", "margin") if getattr(self, k) is not None
        ]
        if self.origin is not None and framing:
            raise ValueError(
                f"{', '.join(framing)} frame the groom automatically and origin places the camera "
                f"by hand; remove one or the other"
            )
        if self.origin is None or self.target is None:
            view = -self._side()
        else:
            view = np.subtract(self.target, self.origin)
            if not np.any(view):
                raise ValueError(f"origin and target are the same point {self.origin}; move one")
        if _sine_between(view, self.up) < 1e-4:
            raise ValueError(f"up = {self.up} is zero or along the view; choose another direction")

    def _check_keys(self) -> None:
        times = [key.time for key in self.keys]
        check_key_times(times)
        opens, closes = self.shutter
        if not times[0] <= opens <= closes <= times[-1]:
            raise ValueError(
                f"shutter = {list(self.shutter)}: keys say where the camera is from {times[0]:g} "
                f"to {times[-1]:g}; open it within that time, or add keys"
            )
        for i, key in enumerate(self.keys):
            for name in ("origin", "target"):
                if getattr(key, name) is None and getattr(self, name) is None:
                    raise ValueError(
                        f"keys[{i}].{name} is missing, and the camera has none; give one of them"
                    )
            try:
                self.at(key.time)
            except ValueError as error:
                raise ValueError(f"keys[{i}]: {error}") from None

    def at(self, time: float) -> Camera:
        """The camera as it keeps still at a time: without keys, the shutter open for no time."""
        if not self.keys:
            return msgspec.structs.replace(self, shutter=(time, time))
        times = [key.time for key in self.keys]
        i = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 2))
        part = (time - times[i]) / (times[i + 1] - times[i])

        def between(name: str) -> Vec3:
            a, b = (
                np.asarray(getattr(key, name) or getattr(self, name), np.float64)
                for key in self.keys[i : i + 2]
            )
            x, y, z = ((1.0 - part) * a + part * b).tolist()
            return x, y, z

        return msgspec.structs.replace(
            self,
            origin=between("origin"),
            target=between("target"),
            up=between("up"),
            shutter=(time, time),
            keys=(),
        )

    @property
    def places(self) -> list[tuple[float, Camera]]:
        """The camera at the times between which it goes straight while the shutter is open, each
        as a part 0 .. 1 of that time; a single one if it keeps still."""
        opens, closes = self.shutter
        if not self.keys or opens == closes:
            return [(0.0, self.at(opens))]
        times = times_within([key.time for key in self.keys], self.shutter)
        return [((time - opens) / (closes - opens), self.at(time)) for time in times]

    def _check_projection(self) -> None:
        if not self.orthographic and self.height is not None:
            raise ValueError(
                f"height = {self.height} belongs to projection = 'orthographic'; give vfov_deg, or "
                f"that projection"
            )
        if self.orthographic and self.vfov_deg != DEFAULT_VFOV_DEG:
            raise ValueError(
                f"vfov_deg = {self.vfov_deg} belongs to projection = 'perspective'; give height "
                f"instead, or leave it out to frame the groom"
            )
        if self.orthographic and self.origin is not None and self.height is None:
            raise ValueError(
                "height is missing: an orthographic camera with an origin needs the height of what "
                "it sees"
            )
        if self.orthographic and self.height is not None and self.margin is not None:
            raise ValueError("margin and height both say how large the groom is; remove one")

    @property
    def orthographic(self) -> bool:
        """Whether rays are parallel."""
        return self.projection == "orthographic"

    @property
    def half_height(self) -> float:
        """Of the film: of its picture at a distance of 1 or, orthographic, at every one [unit].

        Raises
        ------
        ValueError      if an orthographic camera that frames has not been resolved
        """
        if not self.orthographic:
            return math.tan(0.5 * math.radians(self.vfov_deg))
        if self.height is None:
            raise ValueError("the camera frames automatically; call resolved(points, aspect) first")
        return 0.5 * self.height

    def _side(self) -> NDArray[np.float64]:
        azimuth = math.radians(
            DEFAULT_AZIMUTH_DEG if self.azimuth_deg is None else self.azimuth_deg
        )
        elevation = math.radians(
            DEFAULT_ELEVATION_DEG if self.elevation_deg is None else self.elevation_deg
        )
        level = math.cos(elevation)
        return np.array(
            [level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)], np.float64
        )

    def resolved(self, points: ArrayLike, aspect: float = 1.0, radius: float = 0.0) -> Camera:
        """This camera with origin, target and focus distance filled in.

        One with keys is where it is when the shutter opens, and keeps them; where no focus distance
        is given, its focus goes on following the target.

        Parameters
        ----------
        points : (n, 3)       what to frame; unused if the origin is given
        aspect : float        width over height of the film
        radius : float        of a sphere around each point that must be seen too, world units

        Returns
        -------
        Camera                the nearest one, or orthographic that of the least height, that sees
                              all points within the margin: two opposite sides are touched

        Raises
        ------
        ValueError            if the points have no extent
        """
        if self.keys:
            keys = tuple(
                CameraKey(
                    time=key.time,
                    origin=key.origin or self.origin,
                    target=key.target or self.target,
                    up=key.up or self.up,
                )
                for key in self.keys
            )
            still = self.at(self.shutter[0])
            return msgspec.structs.replace(
                self, origin=still.origin, target=still.target, up=still.up, keys=keys
            )
        if self.origin is not None and self.target is not None:
            distance = float(np.linalg.norm(np.subtract(self.target, self.origin)))
            return msgspec.structs.replace(self, focus_distance=self.focus_distance or distance)
        places = self.outermost(points, aspect)
        if radius == 0.0 and not np.ptp(places, axis=0).any():
            raise ValueError("the points to frame are one point; give origin and target instead")
        if self.orthographic:
            return self._resolved_orthographic(places, aspect, radius)
        right, up, forward = _frame(-self._side(), self.up)
        slope = self._free_slope()
        depth = places @ forward
        x, x_depth = _wedge(places @ right, depth, slope * aspect, radius)
        y, y_depth = _wedge(places @ up, depth, slope, radius)
        origin = x * right + y * up + min(x_depth, y_depth) * forward
        distance = float(0.5 * (depth.min() + depth.max()) - origin @ forward)
        if not distance > 0.0:
            raise ValueError(
                "the points to frame are one point; give the camera an origin and target"
            )
        return self._placed(origin, distance * forward, self.height)

    def _resolved_orthographic(
        self, points: NDArray[np.float64], aspect: float, radius: float
    ) -> Camera:
        """The camera of the least height, or of its own, as far away as the points are deep."""
        right, up, forward = _frame(-self._side(), self.up)
        axes = np.stack([right, up, forward])
        places = points @ axes.T
        middle = 0.5 * (places.min(axis=0) + places.max(axis=0)) @ axes
        across, upwards, along = np.ptp(places, axis=0) + 2.0 * radius
        height = max(upwards, across / aspect) / (1.0 - self._margin)
        depth = max(along, height)
        return self._placed(middle - depth * forward, depth * forward, self.height or float(height))

    def _placed(
        self, origin: NDArray[np.float64], view: NDArray[np.float64], height: float | None
    ) -> Camera:
        """This camera at a place, with the vector to its target."""
        return msgspec.structs.replace(
            self,
            origin=tuple(origin.tolist()),
            target=tuple((origin + view).tolist()),
            height=height,
            focus_distance=self.focus_distance or float(np.linalg.norm(view)),
            azimuth_deg=None,
            elevation_deg=None,
            margin=None,
        )

    def outermost(self, points: ArrayLike, aspect: float = 1.0) -> NDArray[np.float64]:
        """Those of points (n, 3) that decide how they are framed, (m, 3): a few in 100 000.

        Points are taken a part at a time, so that not all of them have to be copied.
        """
        return outermost(points, self.framing_directions(aspect))

    def framing_directions(self, aspect: float = 1.0) -> NDArray[np.float64]:
        """Directions (6, 3); the points that are farthest in them decide how all are framed."""
        right, up, forward = _frame(-self._side(), self.up)
        slope = self._free_slope()
        return np.stack(
            [
                *(sign * right - slope * aspect * forward for sign in (1.0, -1.0)),
                *(sign * up - slope * forward for sign in (1.0, -1.0)),
                *(sign * forward for sign in (1.0, -1.0)),
            ]
        )

    @property
    def _margin(self) -> float:
        return DEFAULT_MARGIN if self.margin is None else self.margin

    def _free_slope(self) -> float:
        """Of the wedge that is left for points between the upper and the lower margin."""
        if self.orthographic:
            return 0.0
        return self.half_height * (1.0 - self._margin)

    def frame(self) -> tuple[NDArray[np.float64], ...]:
        """Origin and the unit vectors right, up and forward of an explicit camera, (3,) float64.

        Raises
        ------
        ValueError      if the camera has not been resolved
        """
        if self.origin is None or self.target is None:
            raise ValueError("the camera frames automatically; call resolved(points, aspect) first")
        right, up, forward = _frame(np.subtract(self.target, self.origin), self.up)
        return np.array(self.origin, np.float64), right, up, forward

    def rays(
        self, x: ArrayLike, y: ArrayLike, aspect: float = 1.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Origins and unit directions (n, 3) of the pinhole's rays through places of the film.

        Parameters
        ----------
        x, y : (n,)     on the film, 0..1, y = 0 at the top
        """
        origin, right, up, forward = self.frame()
        x, y = 2.0 * np.asarray(x, np.float64) - 1.0, 1.0 - 2.0 * np.asarray(y, np.float64)
        beside = self.half_height * (aspect * x[:, None] * right + y[:, None] * up)
        if self.orthographic:
            return origin + beside, np.broadcast_to(forward, beside.shape)
        through = forward + beside
        through /= np.linalg.norm(through, axis=1, keepdims=True)
        return np.broadcast_to(origin, through.shape), through

    def on_film(
        self, points: ArrayLike, aspect: float = 1.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Where points (n, 3) are seen: x to the right and y upwards, -1..1 on the film, and depth.

        Those behind a perspective camera, with a depth below 0, are seen nowhere.
        """
        origin, right, up, forward = self.frame()
        beside = np.asarray(points, np.float64) - origin
        depth = beside @ forward
        half = self.half_height * (1.0 if self.orthographic else depth)
        with np.errstate(divide="ignore", invalid="ignore"):
            return beside @ right / (half * aspect), beside @ up / half, depth


def outermost(points: ArrayLike, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those of points (n, 3) that are farthest in directions (k, 3) within a part of all points.

    (m, 3), k for every POINTS_AT_ONCE points: so that not all of them have to be copied.
    """
    points = np.asarray(points)
    found = []
    for begin in range(0, len(points), POINTS_AT_ONCE):
        part = points[begin : begin + POINTS_AT_ONCE].astype(np.float64)
        found.append(part[(directions @ part.T).argmax(axis=1)])
    return np.concatenate(found)


def _frame(view: NDArray[np.float64], up: Vec3) -> tuple[NDArray[np.float64], ...]:
    forward = view / np.linalg.norm(view)
    right = np.cross(forward, np.asarray(up, np.float64))
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward), forward


def _wedge(
    across: NDArray[np.float64], depth: NDArray[np.float64], slope: float, radius: float
) -> tuple[float, float]:
    """Apex (across, depth) of the narrowest symmetric wedge of a slope that holds all points."""
    widen = radius * math.hypot(1.0, slope)
    above = float((across - slope * depth).max()) + widen
    below = float((-across - slope * depth).max()) + widen
    return 0.5 * (above - below), -0.5 * (above + below) / slope


def _sine_between(a: ArrayLike, b: ArrayLike) -> float:
    lengths = float(np.linalg.norm(a) * np.linalg.norm(b))
    return (
        float(np.linalg.norm(np.cross(np.asarray(a), np.asarray(b)))) / lengths if lengths else 0.0
    )
